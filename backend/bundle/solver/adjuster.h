// Bundle adjustment: poses from a bundle problem, by the condensed cost (condensed_cost.h) or by
// any other formulation (formulation.h).
#pragma once

#include <functional>
#include <vector>

#include "backend/bundle/problem.h"
#include "core/options/options.h"

namespace lamina {

struct Formulation;

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

// Pure functions; thread-safe. Deterministic at any number of threads, but for solve_ms. Throw
// std::logic_error for what a formulation cannot express: priors that it does not take, points that
// it needs and that are missing.
BundleResult AdjustBundle(const BundleProblem& problem, const BundleAdjusterOptions& options,
                          const BundleObserver& observer = nullptr);
BundleResult AdjustBundle(const BundleProblem& problem, const BundleAdjusterOptions& options,
                          const Formulation& formulation, const BundleObserver& observer = nullptr);

}  // namespace lamina
