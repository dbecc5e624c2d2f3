// The second level of bundle adjustment: submaps in the place of frames.
//
// The clusters of a submap are the statistics of one rigid frame, so the objective is that of the
// first level (backend/bundle/condensed_cost.h) with anchors for poses:
//
//     min_T  sum_planes 1/2 weight N lambda_3(Sigma(T)) + 1/2 sum_edges |r_e|^2
//
// A round casts all leaves into a voxel map at the present anchors, keeps planes that two submaps
// or more have seen, from one side each (the faces of a wall are two planes), weighs the clusters
// (cap, robust kernel) and solves. The first round takes planes of twice the thickness for planes:
// that is what anchors may be off by. Edges are those of the pose graph; they keep what planes
// leave weak, and what planes leave open is held (backend/bundle/uncertainty/observability.h).
//
// Parts that no edge joins are solved apart; the first submap of each stays where it is.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "backend/anchors/anchor_graph.h"
#include "backend/submaps/result_journal.h"
#include "backend/submaps/submap.h"
#include "core/map/voxel_map.h"
#include "core/options/options.h"

namespace lamina {

struct SubmapBundleOptions {
  // Rounds of association at most; 0: none.
  int rounds = 5;
  // Points that what a submap has of a plane weighs at most.
  double max_cluster_weight = 30.0;
  // Scale of the robust kernel, in standard deviations of the plane.
  double kernel_sigma = 3.0;

  void Visit(OptionVisitor& v);
};

struct SubmapBundleResult {
  std::vector<SE3> anchors;
  int rounds = 0;                            // that counted, of all parts together
  std::size_t planes = 0, observations = 0;  // of the last ones
  double largest_move_m = 0.0;
  std::string refusal;  // of the last part that was left as it was, if any
};

// What is told of the work, and what it goes on from. Both may be left out.
struct SubmapBundleWork {
  // After each round: how many there were, and how far it moved an anchor.
  std::function<void(int, double)> on_round;
  ResultJournal* journal = nullptr;  // keeps what rounds came to
};

// graph.poses: the anchors to start from. Pure function but for `work`; the same bits at any number
// of threads. Throws OptionError.
SubmapBundleResult AdjustSubmaps(const std::vector<const Submap*>& submaps,
                                 const AnchorGraph& graph, const SubmapBundleOptions& options,
                                 const VoxelMapOptions& map, const SubmapBundleWork& work = {});

}  // namespace lamina
