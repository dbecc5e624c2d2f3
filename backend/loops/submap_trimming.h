// Which submaps a map can do without.
//
// A sensor that drives the same rounds for days adds a submap to each place with each round. The
// first visits of a place and the last one stay; what lies between them is trimmed, so that a map
// grows with the space that was seen, not with time.
//
//     visit of a submap   other submaps of one passage that accepted loops join it to, with the
//                         submaps right before and after them
//     covered by a visit  each of its keyframes is near one of the visit's; nearer than storeys
//                         are, where only a third submap joins the two
//     dispensable         covered by loops.kept_visits earlier visits and by a later one
//
// A sensor that turns on the spot, as on a mast, goes no way that loops ask for: each submap is a
// visit of all others whose keyframes stand where its own do and look the same way.
//
// Loops tell visits, not distance alone: storeys, the levels of a bridge and what a sensor of a
// narrow view sees the other way round are places of their own.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "backend/loops/loop.h"
#include "backend/loops/loop_options.h"
#include "backend/submaps/submap.h"

namespace lamina {

struct TrimmingView {
  const std::vector<Submap>& submaps;
  const std::vector<SE3>& anchors;
  const std::vector<double>& ways_m;  // of the sensor to the begin of each
  const std::vector<Loop>& loops;
};

struct DispensableSubmap {
  std::size_t submap = 0;
  std::size_t holder = 0;  // that it moves with: of an earlier visit
};

// The first of those that the newest submap has a loop with, or its predecessors have: earlier
// ones were asked about when those came. The newest two are never among them.
std::optional<DispensableSubmap> FindDispensable(const TrimmingView& map,
                                                 const LoopOptions& options);

}  // namespace lamina
