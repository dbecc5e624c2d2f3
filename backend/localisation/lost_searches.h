// A sensor whose place is unknown while it maps, looked for in the pieces of the map that are
// there.
//
// What comes after a loss is a piece of its own, which nothing connects to those before, and so is
// what another recording begins with. Older pieces that no recording is mapping now do not change:
// their submaps, at the anchors that loops have given them, are what the new piece is looked for
// in, as in a finished map (place_search.h), until it is found or ends.
//
// A look runs in the background, and ends a fixed number of keyframes after it began: the same bits
// at any number of threads. Not thread-safe.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "backend/localisation/place_search.h"
#include "backend/loops/piece_loops.h"
#include "core/base/parallel.h"

namespace lamina {

class LostSearches {
 public:
  LostSearches(const LoopOptions& options, const ScanMatcherOptions& matcher,
               const VoxelMapOptions& map);
  ~LostSearches();

  // Looks for a piece from now on; no effect if it is looked for already.
  void Begin(std::int64_t piece);
  void End(std::int64_t piece);
  // The next keyframe of a piece that has left the window; no effect if it is not looked for.
  void Add(std::int64_t piece, const FinalKeyframe& keyframe);

  // A keyframe has entered the window of a piece that is looked for.
  enum class Step { kNothing, kLookIsDue, kLookHasEnded };
  Step Advance(std::int64_t piece, const SE3& T_own_lidar);
  // A look in these pieces, whose tracks are finished. None of them may change before it has ended,
  // or WaitForLooks().
  void BeginLook(std::int64_t piece, std::vector<FinalKeyframe> window,
                 const std::vector<std::int64_t>& among, const PieceLoops& loops);
  void WaitForLooks();

  // What came of the look that has ended. T_piece_own is in the frame of the map, as corrected by
  // loops.
  const std::optional<FoundPlace>& found(std::int64_t piece) const;
  const PlaceSearch& search(std::int64_t piece) const;

  void Archive(StateArchive& a);

 private:
  struct Search;

  LoopOptions options_;
  ScanMatcherOptions matcher_;
  VoxelMapOptions map_;
  std::map<std::int64_t, std::unique_ptr<Search>> searches_;
  std::set<std::int64_t> ambiguous_;  // pieces that have ended, and what they have repeats
};

}  // namespace lamina
