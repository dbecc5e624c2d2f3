// Evidence of planes about clusters that are moved along a direction (direction_profile.h), for
// four clusters at a time.
//
// The row of a cluster does not depend on which others it is computed with.
//
// Private to frontend/matching.
#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"

namespace lamina {

// A plane as the lanes of registers take it.
struct alignas(32) ProfilePlane {
  double normal[3] = {}, leak2 = 0.0;  // the part of a residual's square that it may feign
  double mean[3] = {}, variance = 0.0;
  double flatness = 0.0, weight = 0.0;  // `weight`: factor on its evidence
  double none[2] = {};
};

// Pose at which clusters are moved, and along which unit vector of the scaled tangent.
struct ProfilePlace {
  Eigen::Matrix3d R;
  Eigen::Vector3d t;
  Vector6d direction;
  double floor2 = 0.0;  // m^2: what no plane is thinner than
};

struct ProfileRow {
  bool says = false;
  double weight = 0.0, loss = 0.0;  // 1/2 - (1 - rho)
};

// Kernel scale of a cluster in standard deviations, points that a cluster weighs at most, and least
// information per weight along the direction that counts.
inline constexpr double kProfileSigma = 2.0, kProfileMostPoints = 4.0, kLeastCounting = 0.05;

// rows[i] of *clusters[i] on *planes[i]. `count` is at least 1.
void MakeProfileRows(const PointCluster* const* clusters, const ProfilePlane* const* planes,
                     std::size_t count, const ProfilePlace& place, ProfileRow* rows);

}  // namespace lamina
