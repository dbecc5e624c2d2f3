// Planes as ties between groups of frames: what moving one group against another costs.
//
// A group moves as one body, by a twist (w, v) of the world about a centre c: a point x goes by
// v + w x (x - c). Of a plane with normal n and axes u1, u2 through mu, a group knows the moments
//
//     F = sum_i  [1 a_i b_i]' [1 a_i b_i],     a, b = coordinates of its points along u1, u2
//
// and its points leave the plane by y = (offset, slope along u1, slope along u2) at each [1 a b].
// With the plane's own three variables eliminated, as in the condensed cost, that costs
//
//     E_n = sum_g (y_g - y*)' F_g (y_g - y*),     y* = (sum F_g)^-1 sum F_g y_g
//
// For two groups alone it is y' F y with F = F_1 (F_1 + F_2)^-1 F_2, y their relative motion: a
// plane ties no better than the one that knows it worse.
//
// Part of it may be feigned by a wrong normal, as for single frames
// (core/geometry/degeneracy.h): with E_1, E_2 the same sums for the motion along u1 and u2, and
// a^2 = NormalError2 of the plane, what counts is
//
//     weight * max(0, E_n - a^2 (E_n + E_1 + E_2))
//
// Twists are scaled: rotations count by what they move at kRotationArmM, so all is in metres.
//
// Private to backend/bundle/uncertainty.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "backend/bundle/plane_geometry.h"
#include "backend/bundle/problem.h"
#include "core/geometry/symmetric3.h"

namespace lamina {

struct PlaneShare {
  int group = 0;
  Symmetric3 moments;
  Eigen::Vector3d origin;  // mean position of the LiDARs that saw these points

  Eigen::Matrix3d F() const { return moments.Dense(); }
};

struct TiedPlane {
  Eigen::Vector3d normal, u1, u2, mean;
  double weight = 0.0, normal_error2 = 0.0;
  std::int32_t first = 0, count = 0;  // its shares: [first, first + count)

  // Offset and slopes (rows) along the normal, u1 and u2 (columns), by a scaled twist about c.
  Eigen::Matrix3d Motion(const Eigen::Vector3d& c, const Vector6d& twist) const;
  // The first column of Motion as a linear function of the twist.
  Eigen::Matrix<double, 3, 6> NormalMotion(const Eigen::Vector3d& c) const;
  // What counts of E = (E_n, E_1, E_2), 1/m^2.
  double Information(const Eigen::Vector3d& E) const;
};

struct TiedPlanes {
  std::vector<TiedPlane> planes;  // those with shares of two groups or more
  std::vector<PlaneShare> shares;
};

// Each frame is in group_of[frame], or left out where that is negative; what is fixed is in
// `fixed_group`. `frames` are the planes' frames at the poses of the problem.
TiedPlanes TiePlanes(const BundleProblem& problem, const std::vector<PlaneFrame>& frames,
                     const std::vector<int>& group_of, int fixed_group);

// The same with group g in the place of all groups with into[group] = g.
TiedPlanes MergeGroups(const TiedPlanes& tied, const std::vector<int>& into);

// (sum F)^-1; finite where the plane has no extent.
Eigen::Matrix3d InverseMoments(const Eigen::Matrix3d& F);

// The row by which a scaled twist about c moves a frame at T along a held direction.
Vector6d HeldRow(const SE3& T, const Vector6d& direction, const Eigen::Vector3d& c);

// A held direction is known to this, 1/m^2: a millimetre.
inline constexpr double kHeldInformation = 1e6;

}  // namespace lamina
