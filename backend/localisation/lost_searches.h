// A sensor that was lost while it maps, looked for where its recording has been before.
//
// What comes after a loss is a piece of its own, which nothing connects to those before. They grow
// no more, and their submaps, at the anchors that loops have given them, are what the new piece is
// looked for in, as in a finished map (place_search.h), until it is found or ends.
//
// Not thread-safe; deterministic.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "backend/localisation/place_search.h"
#include "backend/loops/piece_loops.h"

namespace lamina {

class LostSearches {
 public:
  LostSearches(const LoopOptions& options, const ScanMatcherOptions& matcher,
               const VoxelMapOptions& map);

  // Looks for a piece in these from now on; none of them may change before End().
  void Begin(std::int64_t piece, const std::vector<std::int64_t>& among);
  void End(std::int64_t piece);
  // Null if the piece is not looked for.
  PlaceSearch* Find(std::int64_t piece);
  // T_piece_own of what it finds is in the frame of the map, as corrected by loops.
  std::optional<FoundPlace> Look(std::int64_t piece, const std::vector<FinalKeyframe>& window,
                                 const PieceLoops& loops);

  void Archive(StateArchive& a);

 private:
  struct Search {
    std::vector<std::int64_t> among;
    PlaceSearch search;
    std::unique_ptr<PlaceIndex> places;  // made for the first look

    void Archive(StateArchive& a) { a(&among, &search); }
  };

  LoopOptions options_;
  ScanMatcherOptions matcher_;
  VoxelMapOptions map_;
  std::map<std::int64_t, Search> searches_;
  std::set<std::int64_t> ambiguous_;  // pieces that have ended, and what they have repeats
};

}  // namespace lamina
