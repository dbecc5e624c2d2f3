// The submaps of all pieces of a map, numbered one piece after the other, and what each of them is
// recognised by.
//
// Private to backend/loops.
#pragma once

#include <cstddef>
#include <vector>

#include "backend/loops/loop_options.h"
#include "backend/loops/piece_joining.h"
#include "backend/places/place_image.h"
#include "backend/places/submap_pairs.h"
#include "backend/submaps/work_sharing.h"

namespace lamina {

class PieceSubmaps {
 public:
  // `pieces` must outlive it. Of a single piece there is nothing to recognise.
  PieceSubmaps(const std::vector<MapPiece>& pieces, const PlaceOptions& place);

  std::size_t size() const { return submaps_.size(); }
  const std::vector<const Submap*>& submaps() const { return submaps_; }
  const std::vector<PlaceImage>& images() const { return images_; }
  std::size_t piece_of(std::size_t submap) const { return piece_of_[submap]; }
  // Number of the first submap of each piece.
  const std::vector<std::size_t>& first() const { return first_; }
  // Between two submaps; of different pieces, as far as it matters for drift.
  double WayBetween(std::size_t i, std::size_t j) const;

  // Of each submap those of other pieces that look most like it. Submaps are shared out.
  std::vector<SubmapPair> LookUpAll(const LoopOptions& options, const WorkSharing& sharing) const;

 private:
  void Describe(const PlaceOptions& place);
  std::size_t PieceSize(std::size_t piece) const { return pieces_[piece].submaps->size(); }
  std::vector<SubmapPair> LookUp(std::size_t query, const LoopOptions& options) const;

  const std::vector<MapPiece>& pieces_;
  std::vector<const Submap*> submaps_;
  std::vector<std::size_t> piece_of_, first_;
  std::vector<double> way_;  // of the sensor in its piece, to the submap's begin
  std::vector<PlaceImage> images_;
};

}  // namespace lamina
