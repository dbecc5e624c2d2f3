#include "backend/bundle/formulations/registry.h"

#include <stdexcept>

#include "backend/bundle/formulations/eigen_factors.h"
#include "backend/bundle/formulations/evm1_cost.h"
#include "backend/bundle/formulations/evm2_cost.h"
#include "backend/bundle/formulations/gradient_descent.h"
#include "backend/bundle/formulations/huang_cost.h"
#include "backend/bundle/formulations/plane_landmarks.h"

namespace lamina {

const std::vector<const Formulation*>& Formulations() {
  static const std::vector<const Formulation*> formulations = {
      &CondensedFormulation(),     &HuangFormulation(),        &Evm2Formulation(),
      &Evm1Formulation(),          &EigenFactorsFormulation(), &EigenFactorsLmFormulation(),
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
