// A keyframe as it leaves the sliding window: nothing moves it within its piece any more.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/scan.h"
#include "core/geometry/se3.h"

namespace lamina {

struct FinalKeyframe {
  std::int64_t id = 0;  // in its piece, increasing by one
  StampNs stamp_ns = 0;
  SE3 T_world_lidar;
  // World frame, with the weights with which they join the map's fixed clusters.
  std::vector<PointCluster> clusters;
};

using OnFinalKeyframe = std::function<void(std::int64_t piece, const FinalKeyframe&)>;

}  // namespace lamina
