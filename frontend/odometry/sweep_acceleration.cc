#include "frontend/odometry/sweep_acceleration.h"

#include <Eigen/Cholesky>
#include <algorithm>

#include "core/base/angle.h"
#include "core/geometry/degeneracy.h"

namespace lamina {
namespace {

constexpr double kLeast = 1e-9;

Matrix6d InverseOf(const Matrix6d& m) {
  const Matrix6d regular = m + kLeast * Matrix6d::Identity();
  return regular.ldlt().solve(Matrix6d::Identity());
}

}  // namespace

StepShares SharesOf(const TimedCluster& cluster, double gap_s) {
  const double tau = cluster.mean_time_s;
  return {1.0 + tau / gap_s,
          0.5 * (tau * (tau + gap_s) + cluster.time_scatter / cluster.points.count)};
}

Matrix6d BodyToTangent(const SE3& T_world_lidar) {
  Matrix6d to_tangent = kRotationArmM * Matrix6d::Identity();
  to_tangent.bottomRightCorner<3, 3>() = T_world_lidar.R();
  return to_tangent;
}

SweepAcceleration EstimateAcceleration(const ScanMatcherOptions& options,
                                       const std::vector<PointCluster>& deskewed,
                                       const std::vector<TimedCluster>& timed,
                                       const MatchResult& match, const VoxelMap& map, double gap_s,
                                       const Matrix6d& moment) {
  SweepAcceleration result;
  if (match.status == MatchResult::Status::kTooFewMatches) return result;
  std::vector<StepShares> shares(timed.size());
  for (std::size_t i = 0; i < timed.size(); ++i) shares[i] = SharesOf(timed[i], gap_s);
  MapResiduals residuals(options, map, deskewed);
  residuals.use_rough = match.degenerate > 0;
  const TwoStepRows sums =
      residuals.TwoStepsAt(match.T_world_lidar, options.kernel_end_sigma, shares);
  const Matrix6d to_tangent = BodyToTangent(match.T_world_lidar);
  const Matrix6d& V = match.degenerate_directions;
  const Matrix6d keep = Matrix6d::Identity() - V * V.transpose();
  const Matrix6d H_pose = WithHeld(DividedByArm(sums.pose.H()), V, match.degenerate_information) +
                          1e-9 * sums.pose.H().trace() * Matrix6d::Identity();
  const Matrix6d inverse = H_pose.ldlt().solve(Matrix6d::Identity());
  const Matrix6d H_across = keep * DividedByArm(sums.across.H()) * to_tangent;
  const Matrix6d H_other = to_tangent.transpose() * DividedByArm(sums.other.H()) * to_tangent;
  const Vector6d g_pose = keep * DividedByArm(sums.pose.g());
  const Vector6d g_other = to_tangent.transpose() * DividedByArm(sums.other.g());
  const Matrix6d moved = inverse * H_across;
  result.covariance =
      InverseOf(kCountingShare * (H_other - H_across.transpose() * moved) + InverseOf(moment));
  const Vector6d acceleration =
      -kCountingShare * (result.covariance * (g_other - moved.transpose() * g_pose));
  if (!acceleration.allFinite()) return SweepAcceleration();
  result.acceleration = acceleration;
  result.pose_step = DividedByArm(Vector6d(-inverse * g_pose - moved * acceleration));
  result.pose_covariance = DividedByArm(Matrix6d(moved * result.covariance * moved.transpose()));
  return result;
}

RecentAccelerations::RecentAccelerations(const MotionOptions& options)
    : expected_(Matrix6d::Zero()) {
  const double turn = Radians(options.turn_acceleration_sigma_deg_s2);
  const double way = options.acceleration_sigma_m_s2;
  expected_.diagonal() << Eigen::Vector3d::Constant(turn * turn),
      Eigen::Vector3d::Constant(way * way);
  recent_ = expected_;
}

void RecentAccelerations::Add(const SweepAcceleration& estimate) {
  constexpr double kRecent = 8.0;
  scans_ = std::min(scans_ + 1.0, kRecent);
  recent_ += (estimate.SecondMoment() - recent_) / scans_;
}

Matrix6d RecentAccelerations::Moment() const {
  constexpr double kSudden = 0.1;
  return recent_ + kSudden * kSudden * expected_;
}

}  // namespace lamina
