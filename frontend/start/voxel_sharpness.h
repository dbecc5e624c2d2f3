// How sharp the points of a voxel are: -1/2 log(lambda + s^2), where lambda is the smallest
// eigenvalue of their covariance and s is the sensor's noise (steady_motion.h).
#pragma once

#include <cstddef>
#include <cstdint>

namespace lamina {

// Sums over points, in the plan, about any point near by.
struct alignas(32) VoxelPlan {
  float n = 0.0F, x = 0.0F, y = 0.0F, xx = 0.0F, xy = 0.0F, yy = 0.0F;
  float none[2] = {0.0F, 0.0F};
};

// Further sums, of what is judged in 3D.
struct alignas(16) VoxelHeights {
  float z = 0.0F, xz = 0.0F, yz = 0.0F, zz = 0.0F;
};

// Finds the sharpness of `count` voxels, with the indices `places`. `heights`: null where they are
// judged in plan.
void FindSharpness(const VoxelPlan* plans, const VoxelHeights* heights, const std::int32_t* places,
                   std::size_t count, double noise2, float* sharpness);

}  // namespace lamina
