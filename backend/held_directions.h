// The held directions of a bundle problem, as orthonormal bases.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "backend/bundle_problem.h"

namespace lamina {

using HeldSpace = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, 6>;

// For each frame, orthonormal columns that span the tangent vectors along which it must not move
// (BundleProblem::holds, hold_first_pose): 0 to 6 of them. `scale` is applied to the vectors first,
// for solvers that count rotations in other units.
std::vector<HeldSpace> HeldSpaces(const BundleProblem& problem,
                                  const Vector6d& scale = Vector6d::Ones());

}  // namespace lamina
