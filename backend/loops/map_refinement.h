// All pairs of submaps that lie over one another are compared, and anchors brought to agree.
//
// In the stream a submap is compared with a few that look alike, once, at the anchors of that
// moment. When all is mapped, anchors tell which submaps overlap: each such pair that no edge joins
// is registered from where it lies (submap_registration.h). What is not refused, and stays near,
// is a loop; the graph is solved anew, which drops those that contradict the others, and pairs that
// overlap only now have their turn, until there are none.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "backend/anchors/anchor_graph.h"
#include "backend/loops/loop_closure.h"
#include "backend/loops/loop_options.h"
#include "backend/submaps/result_journal.h"
#include "backend/submaps/submap.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {

struct RefinedGraph {
  AnchorGraph graph;        // present anchors, and all edges that count
  std::vector<Loop> loops;  // that were compared, accepted or not
  int rounds = 0;
};

// graph.poses: the anchors to start from; parts that no edge joins are not compared with one
// another. `progress`: called with the number of pairs that were compared and that are known to be
// due, on this thread. `journal`: keeps what pairs came to. Pure function but for that; the same
// bits at any number of threads. Throws OptionError.
RefinedGraph RefineGraph(const std::vector<const Submap*>& submaps, const AnchorGraph& graph,
                         const LoopOptions& options, const VoxelMapOptions& map,
                         const ScanMatcherOptions& matcher,
                         const std::function<void(std::size_t, std::size_t)>& progress = {},
                         ResultJournal* journal = nullptr);

}  // namespace lamina
