#include "backend/anchors/anchor_prior.h"

#include <Eigen/Eigenvalues>

namespace lamina {

RelativePrior PriorOf(const AnchorEdge& edge) {
  RelativePrior prior;
  prior.T_a_b = edge.T_from_to;
  // The translation of an edge is perturbed in the frame of `to`, that of a prior in `from`.
  Matrix6d J = Matrix6d::Identity();
  J.bottomRightCorner<3, 3>() = edge.T_from_to.R().transpose();
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(edge.information);
  prior.sqrt_information = eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal() *
                           eigen.eigenvectors().transpose() * J;
  return prior;
}

}  // namespace lamina
