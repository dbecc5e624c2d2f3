// The map's planes as they were before a keyframe: made of what is older alone.
//
// Clusters that frames since then have added, and the window still holds, are subtracted. Of points
// that have left the window only a bound is known (VoxelMap::FixedSince): where these points are a
// share 1 - s of a plane, and carry the error x of the poses since then, a scan with that error is
// off from the plane by s x instead of x. Such a plane counts s^2.
//
// Private to backend/pieces.
#pragma once

#include <cstdint>
#include <unordered_map>

#include "backend/window/sliding_window.h"
#include "core/geometry/point_cluster.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {

// Not thread-safe. Holds for the map and the window as they are.
class OlderPlanes {
 public:
  OlderPlanes(const VoxelMap& map, const SlidingWindow& window, std::int64_t first_keyframe);

  // The older plane in the place of a surface of the map; null where too little is that old, or is
  // no plane.
  WeightedPlane Of(VoxelMap::NodeId surface);

 private:
  struct Newer {  // in the window
    PointCluster cluster;
    int frames = 0;
    std::int64_t last_frame = -1;
  };
  struct Older {
    Surface surface;
    double weight = 0.0;
  };
  Older Make(VoxelMap::NodeId surface) const;

  const VoxelMap& map_;
  std::int64_t first_keyframe_;
  double points_per_frame_;
  std::unordered_map<VoxelMap::NodeId, Newer> newer_;
  std::unordered_map<VoxelMap::NodeId, Older> planes_;
};

}  // namespace lamina
