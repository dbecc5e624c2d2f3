// Planes that stand in for the map's surfaces, for evidence about a pose.
#pragma once

#include <functional>

#include "core/map/surface.h"
#include "core/map/voxel_map.h"

namespace lamina {

// `weight` times what it says is counted; null: it says nothing.
struct WeightedPlane {
  const Surface* plane = nullptr;
  double weight = 0.0;
};

using PlanesInstead = std::function<WeightedPlane(VoxelMap::NodeId surface)>;

}  // namespace lamina
