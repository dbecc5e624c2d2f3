#include "backend/bundle/solver/priors.h"

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

namespace {

// add(a, b, block): what block row a and block column b of the matrix get; a, b of the same prior
// in both orders.
template <typename Add>
double SumPriors(const BundleProblem& problem, const std::vector<SE3>& poses,
                 Eigen::VectorXd* gradient, const Add& add) {
  double cost = 0.0;
  for (const RelativePrior& prior : problem.priors) {
    const PriorTerms terms = Linearise(prior, poses[static_cast<std::size_t>(prior.a)],
                                       poses[static_cast<std::size_t>(prior.b)]);
    const int a = 6 * prior.a, b = 6 * prior.b;
    cost += 0.5 * terms.residual.squaredNorm();
    gradient->segment<6>(a) += terms.J_a.transpose() * terms.residual;
    gradient->segment<6>(b) += terms.J_b.transpose() * terms.residual;
    const Matrix6d cross = terms.J_a.transpose() * terms.J_b;
    add(a, a, Matrix6d(terms.J_a.transpose() * terms.J_a));
    add(b, b, Matrix6d(terms.J_b.transpose() * terms.J_b));
    add(a, b, cross);
    add(b, a, Matrix6d(cross.transpose()));
  }
  return cost;
}

}  // namespace

double AddPriors(const BundleProblem& problem, const std::vector<SE3>& poses,
                 Eigen::VectorXd* gradient, Eigen::MatrixXd* H) {
  return SumPriors(problem, poses, gradient,
                   [&](int a, int b, const Matrix6d& block) { H->block<6, 6>(a, b) += block; });
}

double AddPriors(const BundleProblem& problem, const std::vector<SE3>& poses,
                 Eigen::VectorXd* gradient, Eigen::SparseMatrix<double>* H) {
  return SumPriors(problem, poses, gradient, [&](int a, int b, const Matrix6d& block) {
    for (int c = 0; c < 6; ++c) {
      for (int r = 0; r < 6; ++r) {
        if (a + r <= b + c) H->coeffRef(a + r, b + c) += block(r, c);
      }
    }
  });
}

double AddPriorGradient(const BundleProblem& problem, const std::vector<SE3>& poses,
                        Eigen::VectorXd* gradient) {
  return SumPriors(problem, poses, gradient, [](int, int, const Matrix6d&) {});
}

}  // namespace lamina
