// Formulations `eigen_factors` and `eigen_factors_lm`: Eigen-Factors (Ferrer, "Eigen-Factors: Plane
// Estimation for Multi-Frame and Time-Continuous Point Cloud Alignment", IROS 2019).
//
// In homogeneous coordinates q = [p; 1], a frame's points on a plane are S_k = sum q q' (4x4), and
// the plane pi = [nu; d], |pi| = 1, is the eigenvector of the smallest eigenvalue of
//
//     Q = sum_k T_k S_k T_k',       C_EF = 1/2 sum_planes weight lambda_min(Q)
//
// |pi| = 1 instead of |nu| = 1: a plane far from the origin counts for less, and the optimum
// depends on where the origin lies. With y_k = T_k' pi = [R'nu; nu . t + d], the gradient of C_EF
// is
//
//     g_k = Y_k' S_k y_k,     Y_k = dy_k/d[w; t] = [ [R'nu]x  0;  0  nu' ]
//
// `eigen_factors` descends along it (gradient_descent.h). `eigen_factors_lm` writes pi'Q pi = sum_k
// |L_k' y_k|^2 with S_k = L_k L_k' by Cholesky (by the symmetric root where S_k is singular, as for
// the points of an exact plane), holds pi during a step as Huang et al. do for their comparison,
// and so gives Levenberg-Marquardt residuals: its frames decouple.
//
// Private to backend/bundle/formulations.
#pragma once

#include "backend/bundle/cost.h"
#include "backend/bundle/solver/formulation.h"

namespace lamina {

using Matrix4d = Eigen::Matrix4d;

class EigenFactorsCost final : public BundleCost {
 public:
  // Keeps a reference: the problem must outlive the cost. Throws as BundleIndex.
  explicit EigenFactorsCost(const BundleProblem& problem);

  void Linearise(const std::vector<SE3>& poses, ReducedSystem* system) override;
  // With the planes of the last Linearise.
  double Value(const std::vector<SE3>& poses) const override;

  // C_EF with the best planes at these poses, and its gradient (6N).
  double ValueAndGradient(const std::vector<SE3>& poses, Eigen::VectorXd* gradient) const;

 private:
  struct Factor {
    double lambda;
    Eigen::Vector4d pi;
  };
  std::vector<Factor> Factors(const std::vector<SE3>& poses) const;

  const BundleProblem& problem_;
  BundleIndex index_;
  std::vector<Matrix4d> S_;      // of each observation
  std::vector<Matrix4d> roots_;  // L'
  std::vector<Matrix4d> fixed_;  // of each plane: Q's constant part
  std::vector<Factor> held_;
};

const Formulation& EigenFactorsLmFormulation();

}  // namespace lamina
