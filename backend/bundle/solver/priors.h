// The relative priors of a bundle problem, as a share of the normal equations.
//
// Each is 1/2 |sqrt_information LocalDelta(T_a_b, T_world_a^-1 T_world_b)|^2. Its Jacobians neglect
// the curvature of Log, which is second order in the (small) residual.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

#include "backend/bundle/problem.h"

namespace lamina {

double PriorCost(const BundleProblem& problem, const std::vector<SE3>& poses);

// Adds gradient (6N) and Gauss-Newton matrix (6N x 6N, both triangles), and returns the cost.
double AddPriors(const BundleProblem& problem, const std::vector<SE3>& poses,
                 Eigen::VectorXd* gradient, Eigen::MatrixXd* H);
// The same to the upper triangle alone, whose entries must be there (BlockPattern).
double AddPriors(const BundleProblem& problem, const std::vector<SE3>& poses,
                 Eigen::VectorXd* gradient, Eigen::SparseMatrix<double>* H);
// The gradient alone, and the cost.
double AddPriorGradient(const BundleProblem& problem, const std::vector<SE3>& poses,
                        Eigen::VectorXd* gradient);

}  // namespace lamina
