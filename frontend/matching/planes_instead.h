// Planes that stand in for the map's surfaces, for evidence about a pose.
#pragma once

#include <functional>

#include "core/map/surface.h"
#include "core/map/voxel_map.h"

namespace lamina {

// A plane whose evidence counts `weight` times; null: no evidence.
struct WeightedPlane {
  const Surface* plane = nullptr;
  double weight = 0.0;
};

using PlanesInstead = std::function<WeightedPlane(VoxelMap::NodeId surface)>;

// The plane in the place of a surface of the map, which may be VoxelMap::kNoNode: that of
// `instead`, or, without one, the surface itself if it is a plane.
inline WeightedPlane PlaneOf(const VoxelMap& map, VoxelMap::NodeId surface,
                             const PlanesInstead& instead) {
  if (surface == VoxelMap::kNoNode) return WeightedPlane();
  if (instead) return instead(surface);
  if (map.kind(surface) != Surface::Kind::kPlane) return WeightedPlane();
  return {&map.plane(surface), 1.0};
}

}  // namespace lamina
