// The trust region that minimises a BundleCost over the poses.
//
// A step solves (H + diag(H) / radius) delta = -g. With the gain rho = (cost before - after) /
// (decrease that the quadratic model promised), it is taken if rho > 1e-3, and
//
//     taken      radius <- radius / max(1/3, 1 - (2 rho - 1)^3)
//     rejected   radius <- radius / 2, then / 4, / 8, ... while it keeps being rejected
//
// (Madsen, Nielsen, Tingleff: Methods for Non-Linear Least Squares Problems, 2004). A Hessian that
// is not positive definite with its damping counts as a rejected step.
//
// Where the frames decouple (no rows, no priors), a step is N systems of 6x6; otherwise one
// Cholesky factorisation of 6N x 6N: sparse where the problem is large and few frames see planes
// together, else dense.
//
// Private to backend/bundle.
#pragma once

#include "backend/bundle/adjuster.h"
#include "backend/bundle/cost.h"

namespace lamina {

BundleResult MinimiseByLevenbergMarquardt(const BundleProblem& problem, BundleCost* cost,
                                          const BundleAdjusterOptions& options,
                                          const BundleObserver& observer);

}  // namespace lamina
