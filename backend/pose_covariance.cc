#include "backend/pose_covariance.h"

#include <Eigen/Cholesky>

#include "backend/bundle_priors.h"
#include "backend/condensed_cost.h"
#include "backend/held_directions.h"

namespace lamina {
std::vector<Matrix6d> PoseCovariances(const BundleProblem& problem, const std::vector<SE3>& poses,
                                      double open_variance) {
  CondensedCost cost(problem);
  ReducedSystem system;
  cost.Linearise(poses, &system);
  Eigen::MatrixXd H;
  system.Assemble(problem, BundleIndex(problem), &H);
  AddPriors(problem, poses, &system.gradient, &H);
  const std::vector<HeldSpace> held = HeldSpaces(problem);
  // Stiff where held, and a whisper everywhere, so that the factorisation lives.
  const double largest = H.diagonal().maxCoeff() + 1e-300;
  H.diagonal().array() += 1e-14 * largest;
  for (std::size_t k = 0; k < held.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(6 * k);
    H.block<6, 6>(i, i) += 1e8 * largest * held[k] * held[k].transpose();
  }
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> llt(H);
  std::vector<Matrix6d> covariances(poses.size(), Matrix6d::Zero());
  for (std::size_t k = 0; k < poses.size(); ++k) {
    if (held[k].cols() == 6) continue;
    const auto i = static_cast<Eigen::Index>(6 * k);
    Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(H.rows(), 6);
    columns.middleRows<6>(i).setIdentity();
    // With L L' = H the block is X'X, X = L^-1 of these columns: half of a full solve.
    llt.matrixL().solveInPlace(columns);
    covariances[k] =
        columns.bottomRows(H.rows() - i).transpose() * columns.bottomRows(H.rows() - i);
    covariances[k] += open_variance * held[k] * held[k].transpose();
  }
  return covariances;
}

}  // namespace lamina
