#include "backend/pieces/degenerate_stretch.h"

#include <algorithm>
#include <cmath>

#include "backend/pieces/older_planes.h"
#include "core/geometry/decompositions.h"
#include "frontend/matching/degeneracy.h"
#include "frontend/matching/direction_profile.h"

namespace lamina {
namespace {

// A pose that is open by less is in the right minimum: in generated streets the next one was as
// near as 0.25 m.
constexpr double kMinimumM = 0.1;

// Information in a match's covariance (scaled) but for the prediction's share.
Matrix6d MeasuredInformation(const MatchResult& match) {
  constexpr double kLeast = 1e-6;  // m^2
  const Matrix6d covariance = TimesArm(match.covariance) + kLeast * Matrix6d::Identity();
  const Matrix6d left = Matrix6d(covariance.inverse()) - match.prior_information;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(left);
  return solver.eigenvectors() * solver.eigenvalues().cwiseMax(0.0).asDiagonal() *
         solver.eigenvectors().transpose();
}

// Whether there are other minima beside the one that a match has found, along the direction that
// is open most or along the one that the match knows least.
bool MayBeElsewhere(const OdometryFrame& frame, const std::vector<PointCluster>& deskewed,
                    const VoxelMap& map, const ScanMatcherOptions& options,
                    const Vector6d& most_open) {
  constexpr double kBesideM = 0.5;
  const auto open = [&](const Vector6d& v) {
    const DirectionProfile profile(deskewed, map, frame.T_world_lidar, v, options.noise_floor_m);
    const DirectionProfile::Posterior posterior = profile.With(0.0, kBesideM);
    return std::hypot(posterior.mean_m, posterior.sigma_m) > options.max_direction_sigma_m;
  };
  return open(most_open) || open(frame.match.weakest_direction);
}

}  // namespace

void DegenerateStretch::Begin(std::int64_t next_keyframe) {
  open_ = true;
  settled_ = 0;
  first_keyframe_ = next_keyframe;
  covariance_.setZero();
}

void DegenerateStretch::Follow(const OdometryFrame& frame, const MotionModel& motion,
                               const std::vector<TimedCluster>& clusters, const VoxelMap& map,
                               const SlidingWindow& window, std::int64_t next_keyframe) {
  const bool matched = frame.status == OdometryFrame::Status::kTracked;
  if (!open_ && any_ && matched && frame.match.degenerate > 0) Begin(next_keyframe);
  if (open_) {
    const Matrix6d measured = matched ? MeasuredInformation(frame.match) : Matrix6d::Zero();
    Move(frame, motion, measured);
    if (matched) Compare(frame, clusters, map, window, measured);
    const bool determined = matched && frame.match.degenerate == 0;
    settled_ = determined ? settled_ + 1 : 0;
    if (settled_ == 1) settled_keyframe_ = next_keyframe;
    if (determined && SigmaM() <= matcher_.options().max_direction_sigma_m) Forget();
  }
  any_ = true;
  stamp_ns_ = frame.stamp_ns;
  T_world_lidar_ = frame.T_world_lidar;
}

void DegenerateStretch::Move(const OdometryFrame& frame, const MotionModel& motion,
                             const Matrix6d& measured) {
  constexpr double kLeastS = 1e-3;
  const double dt = std::max(kLeastS, SecondsBetween(stamp_ns_, frame.stamp_ns));
  covariance_.block<6, 6>(6, 6) += TimesArm(motion.VelocityChange(dt));
  if (frame.status == OdometryFrame::Status::kTracked) Learn(6, dt * dt * measured);
  const SE3 T_last_this = T_world_lidar_.Inverse() * frame.T_world_lidar;
  Matrix12d F = Matrix12d::Identity();
  F.topLeftCorner<3, 3>() = T_last_this.R().transpose();
  F.block<3, 3>(3, 0) = -T_world_lidar_.R() * Hat(T_last_this.t) / kRotationArmM;
  F.topRightCorner<6, 6>() = dt * Matrix6d::Identity();
  covariance_ = F * covariance_ * F.transpose();
}

void DegenerateStretch::Learn(int block, const Matrix6d& information) {
  // P - P_b (P_bb + M^-1)^-1 P_b' without the inverse of M, which may be singular.
  const Eigen::Matrix<double, 12, 6> across = covariance_.middleCols<6>(block);
  const Matrix6d inside = covariance_.block<6, 6>(block, block);
  const Matrix6d sum = Matrix6d::Identity() + inside * information;
  const Matrix6d gain = information * sum.inverse();
  covariance_ -= across * gain * across.transpose();
  covariance_ = 0.5 * (covariance_ + covariance_.transpose()).eval();
}

void DegenerateStretch::Compare(const OdometryFrame& frame,
                                const std::vector<TimedCluster>& clusters, const VoxelMap& map,
                                const SlidingWindow& window, const Matrix6d& measured) {
  const ScanMatcherOptions& o = matcher_.options();
  // The odometry has seen another minimum beside the one that the planes hold the pose in.
  if (frame.open_m > o.max_direction_sigma_m) return;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(Matrix6d(covariance_.topLeftCorner<6, 6>()));
  const Matrix6d& directions = solver.eigenvectors();
  const std::vector<PointCluster> deskewed = DeskewClusters(clusters, frame.sweep);
  if (SigmaM() > kMinimumM && MayBeElsewhere(frame, deskewed, map, o, directions.col(5))) return;
  OlderPlanes older(map, window, first_keyframe_);
  const DirectionEvidence evidence =
      matcher_.EvidenceOf([&](VoxelMap::NodeId surface) { return older.Of(surface); }, deskewed,
                          frame.T_world_lidar, map, directions);
  Matrix6d information = Matrix6d::Zero();
  for (int k = 0; k < 6; ++k) {
    // Fewer clusters may all be wrong, as in a match.
    if (evidence.Facing(k) < o.min_facing_clusters) continue;
    const Vector6d v = directions.col(k);
    const double along = std::min(evidence.information(k), v.dot(measured * v));
    information += along * v * v.transpose();
  }
  Learn(0, information);
}

double DegenerateStretch::SigmaM() const {
  if (!open_) return 0.0;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(Matrix6d(covariance_.topLeftCorner<6, 6>()),
                                                       Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues()(5)));
}

void DegenerateStretch::Widen(MatchResult* match) const {
  if (!open_) return;
  match->covariance += DividedByArm(Matrix6d(covariance_.topLeftCorner<6, 6>()));
  if (SigmaM() > matcher_.options().max_direction_sigma_m)
    match->degenerate = std::max(1, match->degenerate);
}

void DegenerateStretch::Archive(StateArchive& a) {
  a(&open_, &settled_, &settled_keyframe_, &first_keyframe_, &any_, &stamp_ns_, &T_world_lidar_);
  a.Bytes(covariance_.data(), sizeof(double) * 144);
}

}  // namespace lamina
