// Bundle adjustment with two more unknowns: the sensor's elevation offset and range offset.
//
// Both move a cluster in closed form (sensor_intrinsics.h). With f either field and F its Jacobian
// at the mean mu of a cluster, the residuals of its points (condensed_cost.h), r = m . p + ...,
// have the derivative c = m . f(mu) + g . (p - mu), g = F'm, by that unknown. With c = c0 + g . (p
// - mu) for both at once, c0 of two rows and g 3x2, the sums over the points follow from the
// scatter S alone:
//
//     c'c   = n c0 c0' + g' S g         J'c   = n [a; nu] c0' - [m x S g; 0]
//     c'r   = n c0 nu.x + g' S m        P_j'c = n c0 u_j.x + g' S R'u_j,    P_d'c = -n c0
//
// with x = R mu_k + t - mu. Planes are eliminated as in condensed_cost.h, then the poses: what is
// left is a system of two unknowns, and how the poses follow them.
//
// The gradient is a sum over observations, and is gathered by their elevation as well: with q the
// planes' and slope the poses' answer to a change of the unknowns, an observation's share of it is
//
//     s = c'r + slope_k' J'r + q' P'r
//
// What a beam has wrong for itself is the same in all scans, so its shares are not independent, and
// it is sums by beam whose spread tells how well the unknowns are known.
//
// Private to backend/calibration.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "backend/bundle/problem.h"
#include "frontend/scan/sensor_intrinsics.h"

namespace lamina {

// Columns by elevation, a degree each, from -90 on.
using GradientByElevation = Eigen::Matrix<double, 2, 181>;

// The quadratic model of the cost around the present clusters and poses, planes and poses
// eliminated: cost + g'd + 1/2 d'H d for a change d of the intrinsics, the poses following by the
// tangent step pose_step + pose_slope d (6N).
struct IntrinsicsSystem {
  double cost = 0.0;
  Eigen::Matrix2d H = Eigen::Matrix2d::Zero();
  Eigen::Vector2d g = Eigen::Vector2d::Zero();
  Eigen::VectorXd pose_step;
  Eigen::Matrix<double, Eigen::Dynamic, 2> pose_slope;
  GradientByElevation g_by_elevation = GradientByElevation::Zero();
};

// Held directions of the problem are respected; priors are not looked at. Dense in the poses:
// O(N^3). Deterministic; thread-safe.
IntrinsicsSystem LineariseIntrinsics(const BundleProblem& problem, const std::vector<SE3>& poses);

}  // namespace lamina
