// What a sensor's calibration may have wrong for all its beams alike, and how that moves points.
//
//     elevation offset e (rad)   p -> p turned by e about p x z:   dp/de = E(p)
//     range offset r (m)         p -> p + r p / |p|:               dp/dr = p / |p|
//
//     E(x, y, z) = (-z x / rho, -z y / rho, rho),   rho = sqrt(x^2 + y^2)
//
// in the LiDAR frame, z along the axis about which the sensor spins. Turns and stretches of one
// point commute. Both fields are linear around the mean mu of a cluster, f(p) = f(mu) + F (p - mu)
// with F the field's Jacobian: they move a cluster in closed form, as a pose does.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/geometry/point_cluster.h"

namespace lamina {

using Intrinsics = Eigen::Vector2d;  // [elevation offset (rad); range offset (m)]

// dp / d[elevation; range] at p, which must not be on the z axis.
using IntrinsicsField = Eigen::Matrix<double, 3, 2>;
IntrinsicsField IntrinsicsFieldAt(const Eigen::Vector3d& p);
// The Jacobians of its columns by p.
struct IntrinsicsFieldJacobians {
  Eigen::Matrix3d elevation, range;
};
IntrinsicsFieldJacobians IntrinsicsFieldJacobiansAt(const Eigen::Vector3d& p);

// The clusters of the points moved by these offsets, to first order in their extent about the mean.
// Clusters on the z axis stay as they are. Thread-safe.
std::vector<TimedCluster> Corrected(std::vector<TimedCluster> clusters, const Intrinsics& offsets);

}  // namespace lamina
