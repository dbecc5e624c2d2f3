// The fixed part of the map that scans are matched to, put together from submaps.
//
// In each leaf of the map stands the sum, over the submaps in the order of their ids, of the
// clusters whose means lie in it, each submap's share and the sum capped at
// VoxelMapOptions::max_fixed_weight: visits weigh the same, however many keyframes each has. So
// what a leaf holds follows from the submaps and where they lie, not from what happened before.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "backend/submaps/submap.h"
#include "core/map/voxel_map.h"

namespace lamina {

struct PlacedSubmap {
  const Submap* submap = nullptr;
  SE3 T_world_submap;
};

// Adds leaves of a submap to the fixed clusters of the leaves of a map, its selected piece, in
// which their means lie there. Those that the map cannot hold are left out. No Refresh.
void AddLeaves(const Submap& submap, const SubmapLeaves& leaves, const SE3& T_map_submap,
               VoxelMap* map);

// What stands in each leaf, in the order in which leaves are met, of those that have a mean within
// `radius_m` of a point (world frame); others near that sphere may be among them. Pure function.
std::vector<VoxelMap::FixedPart> SumByLeaf(const std::vector<PlacedSubmap>& submaps,
                                           const VoxelMapOptions& map, const Eigen::Vector3d& at,
                                           double radius_m);

// For VoxelMap::ReplaceFixed. The leaves nearest to `sensor` (world frame) come last. Pure
// function.
std::vector<VoxelMap::FixedPart> AssembleFixed(const std::vector<PlacedSubmap>& submaps,
                                               const VoxelMapOptions& map,
                                               const Eigen::Vector3d& sensor);

}  // namespace lamina
