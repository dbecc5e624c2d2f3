#include "backend/bundle/solver/adjuster.h"

#include <memory>
#include <stdexcept>
#include <string>

#include "backend/bundle/condensed_cost.h"
#include "backend/bundle/solver/formulation.h"
#include "backend/bundle/solver/levenberg_marquardt.h"

namespace lamina {
namespace {

bool StartsFinite(const std::vector<SE3>& poses) {
  for (const SE3& T : poses) {
    if (!T.q.coeffs().allFinite() || !T.t.allFinite()) return false;
  }
  return true;
}

constexpr Formulation kCondensed = {"condensed",
                                    "Lamina",
                                    "this project",
                                    /*needs_points=*/false,
                                    /*takes_priors=*/true,
                                    /*converges_slowly=*/false,
                                    MakeCost<CondensedCost>};

}  // namespace

const Formulation& CondensedFormulation() { return kCondensed; }

void BundleAdjusterOptions::Visit(OptionVisitor& v) {
  v.Integer("max_iterations", &max_iterations, 1, 100000);
  v.Number("min_cost_change", &min_cost_change, 0.0, 1.0);
  v.Integer("min_planes", &min_planes, 3, 1000000);
}

BundleResult AdjustBundle(const BundleProblem& problem, const BundleAdjusterOptions& options,
                          const BundleObserver& observer) {
  return AdjustBundle(problem, options, kCondensed, observer);
}

BundleResult AdjustBundle(const BundleProblem& problem, const BundleAdjusterOptions& options,
                          const Formulation& formulation, const BundleObserver& observer) {
  CheckOptions(options, "backend.solver");
  if (!problem.priors.empty() && !formulation.takes_priors) {
    throw std::logic_error(std::string(formulation.name) + " takes no priors");
  }
  BundleResult result;
  result.poses = problem.poses;
  if (problem.poses.size() < 2 ||
      problem.planes.size() < static_cast<std::size_t>(options.min_planes)) {
    return result;
  }
  if (!StartsFinite(problem.poses)) {
    result.status = BundleResult::Status::kFailed;
    return result;
  }
  if (formulation.solve != nullptr) return formulation.solve(problem, options, observer);
  const std::unique_ptr<BundleCost> cost = formulation.make_cost(problem);
  return MinimiseByLevenbergMarquardt(problem, cost.get(), options, observer,
                                      &formulation == &kCondensed);
}

}  // namespace lamina
