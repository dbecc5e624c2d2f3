// How well a bundle problem determines its poses.
//
// With the weights of the planes equal to 1 / sigma^2 of their points, the covariance of all poses
// at the optimum is the inverse of the condensed Gauss-Newton matrix H (condensed_cost.h): the
// planes' own uncertainty is in it. Capped and robust weights make it that of the information used,
// not of all points.
#pragma once

#include <string>
#include <vector>

#include "backend/bundle/problem.h"

namespace lamina {

// The 6x6 blocks on the diagonal of H^-1, tangent order [rotation; translation] (rad^2, m^2). A
// held frame has zero; along a held direction of a frame that is free otherwise, the variance is
// `open_variance`: nothing is known there. Every other block is positive definite. If H is not, or
// is so close to singular that its inverse is not accurate, the result is empty, and *why_none says
// which. Cost: about two factorisations of H, which is sparse where few frames see planes together
// (selected_inverse.h). Thread-safe. May throw std::bad_alloc.
std::vector<Matrix6d> PoseCovariances(const BundleProblem& problem, const std::vector<SE3>& poses,
                                      double open_variance, std::string* why_none = nullptr);

}  // namespace lamina
