#include "tools/promises/covariance.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>

namespace lamina {
namespace {

Eigen::Matrix3d Cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

// d LocalDelta(T D, Retract(T, delta) D) / d delta at 0.
Matrix6d MovedOn(const SE3& T, const SE3& D) {
  Matrix6d J = Matrix6d::Identity();
  J.topLeftCorner<3, 3>() = D.R().transpose();
  J.bottomLeftCorner<3, 3>() = -T.R() * Cross(D.t);
  return J;
}

}  // namespace

CovarianceCheck CheckCovariance(const std::vector<TrialFrame>& frames) {
  CovarianceCheck check;
  Matrix6d scatter = Matrix6d::Zero();
  for (std::size_t k = 1; k < frames.size(); ++k) {
    const TrialFrame& a = frames[k - 1];
    const TrialFrame& b = frames[k];
    if (a.status != "tracked" || b.status != "tracked" || a.piece != b.piece) continue;
    const SE3 D = a.T_world_lidar_true.Inverse() * b.T_world_lidar_true;
    const Vector6d error = LocalDelta(a.T_world_matched * D, b.T_world_matched);
    const Matrix6d J = MovedOn(a.T_world_matched, D);
    const Matrix6d covariance = J * a.covariance * J.transpose() + b.covariance;
    const Eigen::LLT<Matrix6d> factor(covariance);
    if (factor.info() != Eigen::Success) continue;
    const Vector6d whitened = factor.matrixL().solve(error);
    scatter += whitened * whitened.transpose();
    ++check.pairs;
  }
  if (check.pairs == 0) {
    check.nees_per_dof = check.worst_ratio = std::numeric_limits<double>::quiet_NaN();
    return check;
  }
  scatter /= static_cast<double>(check.pairs);
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(scatter, Eigen::EigenvaluesOnly);
  check.nees_per_dof = scatter.trace() / 6.0;
  check.worst_ratio = std::sqrt(eigen.eigenvalues()[5]);
  return check;
}

}  // namespace lamina
