// What tests of the voxel map fill it with.
#pragma once

#include <cstdint>

#include "core/map/voxel_map.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {

// Everything is a plane.
inline VoxelMapOptions OnlyPlanes() {
  VoxelMapOptions options;
  options.max_flatness = 1.0;
  options.max_thickness_m = 10.0;
  options.min_breadth = 0.0;
  options.max_fixed_weight = 1e9;
  options.depth = 2;
  return options;
}

// Puts each point into its leaf.
inline void AddPoints(const Points& points, std::int64_t frame, VoxelMap* map) {
  for (const Eigen::Vector3d& p : points) map->AddWindow(map->LeafAt(p), ClusterOf({p}), frame);
}

}  // namespace lamina
