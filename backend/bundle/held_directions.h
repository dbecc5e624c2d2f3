// The held directions of a bundle problem, as orthonormal bases.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "backend/bundle/problem.h"

namespace lamina {

using HeldSpace = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, 6>;

// For each frame, orthonormal columns that span the tangent vectors along which it must not move
// (BundleProblem::holds, hold_first_pose): 0 to 6 of them. `scale` is applied to the vectors first,
// for solvers that count rotations in other units.
std::vector<HeldSpace> HeldSpaces(const BundleProblem& problem,
                                  const Vector6d& scale = Vector6d::Ones());

// Makes a frame's diagonal block of a normal matrix whose largest entry is `largest` ready for a
// factorisation that is to keep out of the held directions: stiff along them, and by a share of
// 1e-14 everywhere, so that a frame without planes can be factorised.
void StiffenHeld(const HeldSpace& held, double largest,
                 Eigen::Ref<Matrix6d, 0, Eigen::OuterStride<>> block);

}  // namespace lamina
