// What a node of the map looks like from outside.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "core/geometry/robust_kernel.h"

namespace lamina {

struct Surface {
  enum class Kind : std::uint8_t {
    kEmpty,  // too few points to say anything
    kRough,  // a distribution without a plane
    kPlane,
  };
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  // Of a plane alone:
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();  // unit; the sign has no meaning
  float variance = 0.0F;                             // l3, m^2: the plane's squared thickness
  float flatness = 1.0F;                             // l3 / l2: squared thickness over breadth

  std::uint16_t frames = 0;  // that contributed, saturating
  Kind kind = Kind::kEmpty;

  // Signed distance of a point from the plane; of a plane alone.
  double Distance(const Eigen::Vector3d& p) const { return normal.cast<double>().dot(p - mean); }
};
static_assert(sizeof(Surface) == 48);

// The robust kernel's weight of a cluster at p on a plane: its scale is `kernel_sigma` standard
// deviations of what the plane's thickness and the noise make together.
inline double KernelWeight(const Surface& plane, const Eigen::Vector3d& p, double noise_floor_m,
                           double kernel_sigma) {
  const double distance = plane.Distance(p);
  const double variance = noise_floor_m * noise_floor_m + static_cast<double>(plane.variance);
  return GemanMcClureWeight(distance * distance / (kernel_sigma * kernel_sigma * variance));
}

}  // namespace lamina
