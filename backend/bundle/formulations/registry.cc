#include "backend/bundle/formulations/registry.h"

#include <stdexcept>

#include "backend/bundle/formulations/alternating_cost.h"
#include "backend/bundle/formulations/eigen_factors.h"
#include "backend/bundle/formulations/gradient_descent.h"
#include "backend/bundle/formulations/plane_landmarks.h"
#include "backend/bundle/formulations/pointwise_cost.h"
#include "backend/bundle/formulations/second_order_cost.h"

namespace lamina {

const std::vector<const Formulation*>& Formulations() {
  static const std::vector<const Formulation*> formulations = {
      &CondensedFormulation(),     &AlternatingFormulation(),
      &SecondOrderFormulation(),   &PointwiseFormulation(),
      &EigenFactorsFormulation(),  &EigenFactorsLeastSquaresFormulation(),
      &PlaneLandmarksFormulation()};
  return formulations;
}

const std::vector<std::string>& FormulationNames() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (const Formulation* formulation : Formulations()) list.emplace_back(formulation->name);
    return list;
  }();
  return names;
}

const Formulation& FindFormulation(const std::string& name) {
  for (const Formulation* formulation : Formulations()) {
    if (formulation->name == name) return *formulation;
  }
  throw std::logic_error("there is no formulation '" + name + "'");
}

}  // namespace lamina
