// Whether two scans show the same place: what a new piece of a map may be begun with. Rain, spray,
// a hand before the lens agree with nothing, not even with themselves a moment later.
#pragma once

#include <vector>

#include "core/point_cluster.h"
#include "core/voxel_map.h"
#include "frontend/scan_matcher.h"

namespace lamina {

// Matches scan b to a map of scan a alone, from the expected pose T_a_b on. Clusters are deskewed,
// each in its own LiDAR frame. Thread-safe.
bool ScansAgree(const std::vector<PointCluster>& a, const std::vector<PointCluster>& b,
                const PosePrediction& T_a_b, const VoxelMapOptions& map_options,
                const ScanMatcher& matcher);

}  // namespace lamina
