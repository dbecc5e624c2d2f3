// A point of a cloud in the world.
#pragma once

#include "core/geometry/se3.h"

namespace lamina {

struct CloudPoint {
  Eigen::Vector3d p;
  float intensity = 0.0F;
  double stamp_s = 0.0;  // when it was measured, on the recording's clock
};

}  // namespace lamina
