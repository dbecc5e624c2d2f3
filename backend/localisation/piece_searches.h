// Localising without a start: the places of a finished map, and the pieces that are looked for in
// it, each by a PlaceSearch of its own.
//
// Not thread-safe; deterministic.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "backend/localisation/place_search.h"

namespace lamina {

class PieceSearches {
 public:
  // Describes the places out of the map. Throws OptionError.
  PieceSearches(const LoopOptions& options, const ScanMatcherOptions& matcher,
                const std::vector<MapPlace>& places, const VoxelMap& map);
  // For Archive() to read into.
  PieceSearches(const LoopOptions& options, const ScanMatcherOptions& matcher, double leaf_size_m);

  // Looks for a piece from now on.
  PlaceSearch* Begin(std::int64_t piece);
  void End(std::int64_t piece) { searches_.erase(piece); }
  // Null if the piece is not looked for.
  PlaceSearch* Find(std::int64_t piece);
  // The next keyframe of a piece that has left the window; no effect if it is not looked for.
  void Add(std::int64_t piece, const FinalKeyframe& keyframe);
  std::optional<FoundPlace> Look(PlaceSearch* search, std::vector<FinalKeyframe> window,
                                 const VoxelMap& map) const {
    return search->Look(search->BeginLook(std::move(window)), *places_, map);
  }

  // Reading describes the places anew.
  void Archive(StateArchive& a, const VoxelMap& map);

 private:
  LoopOptions options_;
  ScanMatcherOptions matcher_;
  double leaf_size_m_;
  std::unique_ptr<PlaceIndex> places_;
  std::map<std::int64_t, PlaceSearch> searches_;
};

}  // namespace lamina
