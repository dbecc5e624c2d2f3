// The trust region that minimises a BundleCost over the poses.
//
// The steps: trust_region.h.
//
// Of a large system, and of a window's where convergence is coarse (kCoarseEnd), H and its factor
// are kept after a small step that has brought what the model promised (kKeepStep): a new gradient
// costs a pass over the observations, a new H their products. What H lacks since then, and what it
// never had, the gradients tell: each pair of a step s and the change y of the gradient along it
// corrects the factor as in BFGS,
//
//     B <- B - B s s' B / s' B s + y y' / s' y          (Nocedal and Wright, 7.2, with B_0 = H)
//
// The gradient decides where the minimum is, H only how to get there; where such a step is
// rejected, H is made anew.
//
// Where the frames decouple (no rows, no priors), a step is N systems of 6x6; otherwise one
// Cholesky factorisation of 6N x 6N: sparse (sparse_cholesky.h) where the problem is large and that
// saves multiplications enough, else dense.
//
// Private to backend/bundle/solver.
#pragma once

#include "backend/bundle/cost.h"
#include "backend/bundle/solver/adjuster.h"

namespace lamina {

// `may_keep`: whether H may be kept. Formulations that are compared make it at each step.
BundleResult MinimiseByLevenbergMarquardt(const BundleProblem& problem, BundleCost* cost,
                                          const BundleAdjusterOptions& options,
                                          const BundleObserver& observer, bool may_keep);

}  // namespace lamina
