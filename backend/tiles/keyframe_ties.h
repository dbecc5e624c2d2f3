// What ties the keyframes of a map to one another beside the planes that they see: odometry from
// each to the next, and loops between their submaps. A submap's frame is that of its first
// keyframe.
//
// Odometry of a way w is off by sqrt(w L) times what loops.drift_sigma_* says of a way L, that of a
// submap: a random walk that over L comes to the same.
#pragma once

#include <cstddef>
#include <vector>

#include "backend/anchors/anchor_graph.h"
#include "backend/bundle/problem.h"
#include "backend/loops/loop_options.h"
#include "backend/submaps/submap.h"

namespace lamina {

// The first keyframe of each submap among all of them, and their number at the end.
std::vector<std::size_t> FirstKeyframes(const std::vector<const Submap*>& submaps);

// Keyframes of all submaps in their order. `poses`: their start. `graph`: of these submaps; its
// edges count, not its anchors. The first pose is held.
BundleProblem TiesOfKeyframes(const std::vector<const Submap*>& submaps, const AnchorGraph& graph,
                              const std::vector<SE3>& poses, const LoopOptions& options);

}  // namespace lamina
