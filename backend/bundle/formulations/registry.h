// The formulations of bundle adjustment that can be chosen by name.
//
//   condensed         planes condensed out, Gauss-Newton                   bundle/condensed_cost.h
//   huang             the paper's objective, planes held during a step     huang_cost.h
//   evm2              the same cost as condensed, exact Hessian (BALM 2)   evm2_cost.h
//   evm1              point by point, second order (BALM)                  evm1_cost.h
//   eigen_factors     Eigen-Factors, first-order descent                   eigen_factors.h
//   eigen_factors_lm  the same as least squares                            eigen_factors.h
//   plane_landmarks   planes as parameters beside the poses (LIPS)         plane_landmarks.h
//
// A new one is a file pair beside these that gives a Formulation, and a line in registry.cc.
#pragma once

#include <string>
#include <vector>

#include "backend/bundle/solver/formulation.h"

namespace lamina {

// In the order of the table; they live as long as the program.
const std::vector<const Formulation*>& Formulations();
const std::vector<std::string>& FormulationNames();

// Throws std::logic_error if there is none of this name.
const Formulation& FindFormulation(const std::string& name);

}  // namespace lamina
