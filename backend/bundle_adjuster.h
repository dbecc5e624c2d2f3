// Bundle adjustment of a window: the condensed cost, driven by Ceres.
//
// The whole window is one ceres::CostFunction over N pose blocks. With H = A'A (Cholesky), q = A^-T
// g and the cost C,
//
//     residuals = [q; sqrt(2C - |q|^2)],   Jacobian = [A; 0]     =>  J'J = H,  J'r = g,  |r|^2 / 2
//     = C
//
// so that Ceres' trust region works on exactly the reduced system, and priors are ordinary residual
// blocks beside it.
#pragma once

#include <vector>

#include "backend/bundle_problem.h"
#include "core/options.h"

namespace lamina {

struct BundleAdjusterOptions {
  int max_iterations = 6;
  // Converged when a step lowers the cost by less than this share.
  double min_cost_change = 1e-5;
  // Fewer planes than this: refused.
  int min_planes = 20;

  void Visit(OptionVisitor& v);
};

struct BundleResult {
  enum class Status {
    kConverged,
    kIterationLimit,  // usable
    kTooFewPlanes,    // refused; poses are the start values
    kFailed,          // numerical failure; poses are the start values
  };
  Status status = Status::kTooFewPlanes;
  std::vector<SE3> poses;
  double initial_cost = 0.0, final_cost = 0.0;  // C of condensed_cost.h, priors included
  int iterations = 0;                           // steps tried
  bool usable() const { return status == Status::kConverged || status == Status::kIterationLimit; }
};

// Pure function; thread-safe. Deterministic at any number of threads.
BundleResult AdjustBundle(const BundleProblem& problem, const BundleAdjusterOptions& options);

}  // namespace lamina
