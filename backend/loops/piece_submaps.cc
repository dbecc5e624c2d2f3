#include "backend/loops/piece_submaps.h"

#include <algorithm>
#include <cmath>

#include "backend/places/place_lookup.h"
#include "backend/places/submap_place.h"
#include "core/base/parallel.h"

namespace lamina {
namespace {

// Way between submaps of different pieces of a part, as far as it matters for drift.
constexpr double kOtherPieceWayM = 60.0;
// A piece of fewer submaps looks for itself in later ones, too.
constexpr std::size_t kFewSubmaps = 3;
// Registrations of a submap, times those within a piece: rivals must be seen.
constexpr std::size_t kRegistrationsFactor = 2;

}  // namespace

PieceSubmaps::PieceSubmaps(const std::vector<MapPiece>& pieces, const PlaceOptions& place)
    : pieces_(pieces) {
  for (std::size_t p = 0; p < pieces.size(); ++p) {
    first_.push_back(submaps_.size());
    double way = 0.0;
    for (const Submap& submap : *pieces[p].submaps) {
      submaps_.push_back(&submap);
      piece_of_.push_back(p);
      way_.push_back(way);
      way += submap.way_m;
    }
  }
  if (pieces.size() > 1) Describe(place);
}

void PieceSubmaps::Describe(const PlaceOptions& place) {
  images_.resize(submaps_.size());
  ParallelChunks(pieces_.size(), 1, [&](std::size_t p, std::size_t) {
    for (std::size_t i = first_[p]; i < first_[p] + PieceSize(p); ++i) {
      // A piece may have been joined of several.
      const bool follows = i > first_[p] && Follows(*submaps_[i], *submaps_[i - 1]);
      images_[i] =
          ImageOfSubmap(*submaps_[i], LeafPlanes(*submaps_[i]), follows ? submaps_[i - 1] : nullptr,
                        follows ? &images_[i - 1] : nullptr, place);
    }
  });
}

double PieceSubmaps::WayBetween(std::size_t i, std::size_t j) const {
  return piece_of_[i] == piece_of_[j] ? std::abs(way_[i] - way_[j]) : kOtherPieceWayM;
}

std::vector<SubmapPair> PieceSubmaps::LookUp(std::size_t query, const LoopOptions& options) const {
  const std::size_t piece = piece_of_[query];
  std::vector<std::size_t> others;
  std::vector<const PlaceImage*> images;
  for (std::size_t i = 0; i < submaps_.size(); ++i) {
    const std::size_t other = piece_of_[i];
    const bool few = std::min(PieceSize(piece), PieceSize(other)) < kFewSubmaps;
    if (other == piece || (other > piece && !few)) continue;
    others.push_back(i);
    images.push_back(&images_[i]);
  }
  std::vector<SubmapPair> pairs;
  if (others.empty()) return pairs;
  const std::size_t most = kRegistrationsFactor * static_cast<std::size_t>(options.registrations);
  for (const PlaceHypothesis& found : LookUpPlace(images_[query], images, options.place)) {
    if (pairs.size() == most) break;
    pairs.push_back({others[found.other], query, found.T_other_query, found.score});
  }
  return pairs;
}

std::vector<SubmapPair> PieceSubmaps::LookUpAll(const LoopOptions& options,
                                                const WorkSharing& sharing) const {
  std::vector<std::size_t> owner;
  for (std::size_t query = 0; query < submaps_.size(); ++query)
    owner.push_back(query % sharing.parts);
  const auto found = ShareOut<std::vector<SubmapPair>>(
      owner, sharing, [&](const std::vector<std::size_t>& queries) {
        std::vector<std::vector<SubmapPair>> mine;
        for (const std::size_t query : queries) mine.push_back(LookUp(query, options));
        return mine;
      });
  std::vector<SubmapPair> pairs;
  for (const auto& of_query : found) pairs.insert(pairs.end(), of_query.begin(), of_query.end());
  return pairs;
}

}  // namespace lamina
