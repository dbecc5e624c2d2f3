// First-order descent over the poses: Nesterov's accelerated gradient with a step length found by
// backtracking, restarted whenever the cost would rise (O'Donoghue and Candes, 2015).
//
// Rotations and translations are brought to one unit by a fixed arm length, the root mean square
// range of the points. Needs no Hessian and takes hundreds to thousands of steps.
//
// Private to backend/bundle/formulations.
#pragma once

#include "backend/bundle/formulations/eigen_factors.h"
#include "backend/bundle/solver/formulation.h"

namespace lamina {

BundleResult DescendEigenFactors(const BundleProblem& problem, const BundleAdjusterOptions& options,
                                 const BundleObserver& observer);

const Formulation& EigenFactorsFormulation();

}  // namespace lamina
