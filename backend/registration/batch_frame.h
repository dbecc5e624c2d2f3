// A scan of a batch that is to be registered.
#pragma once

#include <vector>

#include "core/geometry/packed_scan.h"
#include "core/geometry/scan.h"
#include "frontend/scan/scan_preparation.h"

namespace lamina {

struct BatchFrame {
  StampNs stamp_ns = 0;
  SE3 T_world_lidar;    // initial
  PackedScan clusters;  // at the leaf size of the final round; may be empty
  // The points of each cluster; empty unless the formulation needs them.
  std::vector<std::vector<TimedPoint>> points;
};

}  // namespace lamina
