// A formulation of bundle adjustment: how poses are found from a bundle problem, as a value that
// solvers and reports can be handed.
//
// One with normal equations gives its cost, and AdjustBundle minimises it by the trust region that
// all of these share (levenberg_marquardt.h), so that what differs is the formulation. One without
// them brings a solver of its own.
//
// Lamina itself uses CondensedFormulation(). The published ones, to compare with, are listed in
// backend/bundle/formulations/registry.h.
#pragma once

#include <memory>

#include "backend/bundle/cost.h"
#include "backend/bundle/problem.h"
#include "backend/bundle/solver/adjuster.h"

namespace lamina {

struct Formulation {
  const char* name;               // in options and in results
  const char* title;              // of its paper
  const char* source;             // authors and year
  bool needs_points = false;      // BundleProblem::points
  bool takes_priors = false;      // BundleProblem::priors
  bool converges_slowly = false;  // by nature: needs several times the steps of others
  // Exactly one of the two. A cost keeps a reference to the problem.
  std::unique_ptr<BundleCost> (*make_cost)(const BundleProblem& problem) = nullptr;
  BundleResult (*solve)(const BundleProblem& problem, const BundleAdjusterOptions& options,
                        const BundleObserver& observer) = nullptr;
};

// Planes condensed out, Gauss-Newton (condensed_cost.h).
const Formulation& CondensedFormulation();

// For Formulation::make_cost.
template <typename Cost>
std::unique_ptr<BundleCost> MakeCost(const BundleProblem& problem) {
  return std::make_unique<Cost>(problem);
}

}  // namespace lamina
