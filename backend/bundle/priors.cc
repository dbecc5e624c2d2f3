#include "backend/bundle/priors.h"

namespace lamina {
namespace {

struct PriorTerms {
  Vector6d residual;
  Matrix6d J_a, J_b;
};

PriorTerms Linearise(const RelativePrior& prior, const SE3& a, const SE3& b) {
  const SE3 T_a_b = a.Inverse() * b;
  const Eigen::Matrix3d Rt = a.R().transpose();
  PriorTerms terms;
  terms.residual = prior.sqrt_information * LocalDelta(prior.T_a_b, T_a_b);
  Matrix6d J = Matrix6d::Zero();
  J.topLeftCorner<3, 3>() = -T_a_b.R().transpose();
  J.bottomLeftCorner<3, 3>() = Hat(T_a_b.t);
  J.bottomRightCorner<3, 3>() = -Rt;
  terms.J_a = prior.sqrt_information * J;
  J.setZero();
  J.topLeftCorner<3, 3>().setIdentity();
  J.bottomRightCorner<3, 3>() = Rt;
  terms.J_b = prior.sqrt_information * J;
  return terms;
}

}  // namespace

double PriorCost(const BundleProblem& problem, const std::vector<SE3>& poses) {
  double cost = 0.0;
  for (const RelativePrior& prior : problem.priors) {
    const SE3 T_a_b = poses[static_cast<std::size_t>(prior.a)].Inverse() *
                      poses[static_cast<std::size_t>(prior.b)];
    cost += 0.5 * (prior.sqrt_information * LocalDelta(prior.T_a_b, T_a_b)).squaredNorm();
  }
  return cost;
}

double AddPriors(const BundleProblem& problem, const std::vector<SE3>& poses,
                 Eigen::VectorXd* gradient, Eigen::MatrixXd* H) {
  double cost = 0.0;
  for (const RelativePrior& prior : problem.priors) {
    const PriorTerms terms = Linearise(prior, poses[static_cast<std::size_t>(prior.a)],
                                       poses[static_cast<std::size_t>(prior.b)]);
    const int a = 6 * prior.a, b = 6 * prior.b;
    cost += 0.5 * terms.residual.squaredNorm();
    gradient->segment<6>(a) += terms.J_a.transpose() * terms.residual;
    gradient->segment<6>(b) += terms.J_b.transpose() * terms.residual;
    const Matrix6d cross = terms.J_a.transpose() * terms.J_b;
    H->block<6, 6>(a, a) += terms.J_a.transpose() * terms.J_a;
    H->block<6, 6>(b, b) += terms.J_b.transpose() * terms.J_b;
    H->block<6, 6>(a, b) += cross;
    H->block<6, 6>(b, a) += cross.transpose();
  }
  return cost;
}

}  // namespace lamina
