#include "backend/bundle/adjuster.h"

#include <stdexcept>

#include "backend/bundle/condensed_cost.h"
#include "backend/bundle/formulations/alternating_cost.h"
#include "backend/bundle/formulations/eigen_factors.h"
#include "backend/bundle/formulations/gradient_descent.h"
#include "backend/bundle/formulations/plane_landmarks.h"
#include "backend/bundle/formulations/pointwise_cost.h"
#include "backend/bundle/formulations/second_order_cost.h"
#include "backend/bundle/levenberg_marquardt.h"

namespace lamina {
namespace {

bool StartsFinite(const std::vector<SE3>& poses) {
  for (const SE3& T : poses) {
    if (!T.q.coeffs().allFinite() || !T.t.allFinite()) return false;
  }
  return true;
}

bool TakesPriors(Formulation formulation) {
  return formulation == Formulation::kCondensed || formulation == Formulation::kEvm2 ||
         formulation == Formulation::kEvm1;
}

}  // namespace

const std::vector<std::string>& FormulationNames() {
  static const std::vector<std::string> names = {"condensed", "huang", "evm2", "evm1",
                                                 "ef",        "ef_lm", "pl"};
  return names;
}

void BundleAdjusterOptions::Visit(OptionVisitor& v) {
  v.Integer("max_iterations", &max_iterations, 1, 100000);
  v.Number("min_cost_change", &min_cost_change, 0.0, 1.0);
  v.Integer("min_planes", &min_planes, 3, 1000000);
}

std::unique_ptr<BundleCost> MakeBundleCost(const BundleProblem& problem, Formulation formulation) {
  switch (formulation) {
    case Formulation::kCondensed:
      return std::make_unique<CondensedCost>(problem);
    case Formulation::kHuang:
      return std::make_unique<AlternatingCost>(problem);
    case Formulation::kEvm2:
      return std::make_unique<SecondOrderCost>(problem);
    case Formulation::kEvm1:
      return std::make_unique<PointwiseCost>(problem);
    case Formulation::kEfLm:
      return std::make_unique<EigenFactorsCost>(problem);
    case Formulation::kEf:
    case Formulation::kPl:
      break;
  }
  throw std::logic_error(FormulationNames().at(static_cast<std::size_t>(formulation)) +
                         " has no normal equations of the poses alone");
}

BundleResult AdjustBundle(const BundleProblem& problem, const BundleAdjusterOptions& options,
                          Formulation formulation, const BundleObserver& observer) {
  CheckOptions(options, "backend.solver");
  if (!problem.priors.empty() && !TakesPriors(formulation)) {
    throw std::logic_error("priors are for condensed, evm2 and evm1 alone");
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
  if (formulation == Formulation::kEf) return DescendEigenFactors(problem, options, observer);
  if (formulation == Formulation::kPl) return SolvePlaneLandmarks(problem, options, observer);
  const std::unique_ptr<BundleCost> cost = MakeBundleCost(problem, formulation);
  return MinimiseByLevenbergMarquardt(problem, cost.get(), options, observer);
}

}  // namespace lamina
