// Bundle adjustment: poses from a bundle problem, by any of the formulations.
//
//   condensed  planes condensed out, Gauss-Newton                        condensed_cost.h
//   huang      the paper's objective, planes held during a step          alternating_cost.h
//   evm2       the same cost as condensed, exact Hessian (BALM 2)        second_order_cost.h
//   evm1       point by point, second order (BALM)                       pointwise_cost.h
//   ef         Eigen-Factors, first-order descent                        eigen_factors.h
//   ef_lm      Eigen-Factors as least squares                            eigen_factors.h
//   pl         planes as parameters beside the poses (LIPS)              plane_landmarks.h
//
// All but ef and pl are minimised by the same trust region (levenberg_marquardt.h), so that what
// differs is the formulation.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "backend/bundle/cost.h"
#include "backend/bundle/problem.h"
#include "core/options/options.h"

namespace lamina {

enum class Formulation { kCondensed, kHuang, kEvm2, kEvm1, kEf, kEfLm, kPl };
// Their names, in the order of the enumeration.
const std::vector<std::string>& FormulationNames();

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
  // Of the formulation's own cost, priors included.
  double initial_cost = 0.0, final_cost = 0.0;
  int iterations = 0;  // steps tried
  // Wall time of the solve, without what observers took. For reports alone: nothing depends on it.
  double solve_ms = 0.0;
  bool usable() const { return status == Status::kConverged || status == Status::kIterationLimit; }
};

// A step that a solver has tried.
struct BundleStep {
  int iteration = 0;  // from 1
  bool accepted = false;
  double cost = 0.0;      // after it, or before it if it was rejected
  double step = 0.0;      // largest component, rad or m
  double solve_ms = 0.0;  // wall time since the start of the solve
};
// Told of each step, and of the poses after it.
using BundleObserver = std::function<void(const BundleStep&, const std::vector<SE3>& poses)>;

// Pure function; thread-safe. Deterministic at any number of threads, but for solve_ms. Throws
// std::logic_error for what a formulation cannot express: points missing for evm1, priors with ef,
// ef_lm, huang, or pl.
BundleResult AdjustBundle(const BundleProblem& problem, const BundleAdjusterOptions& options,
                          Formulation formulation = Formulation::kCondensed,
                          const BundleObserver& observer = nullptr);

// The cost of a formulation that has normal equations: all but ef and pl, for which it throws
// std::logic_error. Keeps a reference to the problem.
std::unique_ptr<BundleCost> MakeBundleCost(const BundleProblem& problem, Formulation formulation);

}  // namespace lamina
