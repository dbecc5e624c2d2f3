// How sharp the points of a voxel are: -1/2 log(lambda + s^2), where lambda is the smallest
// eigenvalue of their covariance and s is the sensor's noise (steady_motion.h).
#pragma once

#include <cstdint>
#include <vector>

namespace lamina {

// Sums over the points of a voxel, in the plan, about any point near by.
struct alignas(32) VoxelPlan {
  float n = 0.0F, x = 0.0F, y = 0.0F, xx = 0.0F, xy = 0.0F, yy = 0.0F;
  std::int32_t first_scan = 0;
  std::int32_t others = 0;  // not 0 if further scans see it
};

// Those beside them of what is judged in space.
struct alignas(16) VoxelHeights {
  float z = 0.0F, xz = 0.0F, yz = 0.0F, zz = 0.0F;
};

// Of the voxels at these places. `heights`: null where they are judged in the plan.
void FindSharpness(const VoxelPlan* plans, const VoxelHeights* heights,
                   const std::vector<std::int32_t>& places, double noise2, float* sharpness);

}  // namespace lamina
