// Poses of a sequence without any initial guess: pairs by a global method, then a pose graph.
//
//   1. Scan k against scans k - 1, ..., k - near; and back to k - 3 near while some scan is
//      joined to none.
//   2. The spanning tree of greatest weight gives first poses, and with them overlaps. Weight:
//      matches that agree, times the overlap to the fourth power; where things repeat, matches
//      agree on the wrong place, and less of the scans meets.
//   3. Pairs farther apart in the sequence that overlap by more than min_overlap (share of the
//      points of either that meet the other's) are registered, too, for each scan those of the
//      greatest overlap first.
//   4. All of them make a pose graph with a robust kernel (pose_graph.h).
#pragma once

#include <vector>

#include "backend/registration/pose_graph.h"
#include "core/options/options.h"
#include "frontend/pairwise/pairwise_odometry.h"

namespace lamina {

struct SynchronisationOptions {
  int near = 2;
  double min_overlap = 0.6;
  // For each scan at most, besides the near ones.
  int pairs_per_scan = 3;
  PoseGraphOptions graph;

  void Visit(OptionVisitor& v);
};

struct SynchronisationResult {
  // Pairs of neighbours alone, chained: fails with the first pair that fails.
  PairwiseSequenceResult chain;
  // All pairs, synchronised.
  PairwiseSequenceResult synchronised;
  std::size_t pairs = 0, registered = 0, rejected = 0;
};

// `on_chain` is told when the neighbours are done, `progress` after each scan of the near and of
// the far pairs. Deterministic.
SynchronisationResult RegisterGlobally(
    const PairwiseMethod& method, const std::vector<PairwiseCloud>& clouds,
    const SynchronisationOptions& options, const PairwiseProgress& progress,
    const std::function<void(const PairwiseSequenceResult&)>& on_chain);

}  // namespace lamina
