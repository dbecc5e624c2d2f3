#include "backend/pieces/degenerate_stretch.h"

#include <algorithm>
#include <cmath>

#include "backend/pieces/older_planes.h"
#include "core/geometry/decompositions.h"
#include "core/geometry/degeneracy.h"
#include "frontend/matching/direction_profile.h"

namespace lamina {
namespace {

// Distance of the next minimum in generated streets. A pose that is open by less than kMinimumM is
// in the right one.
constexpr double kNextMinimumM = 0.25, kMinimumM = 0.1, kLikelySigmas = 2.0;

// Information in a match's covariance (scaled) but for the prediction's share.
Matrix6d MeasuredInformation(const MatchResult& match) {
  constexpr double kLeast = 1e-6;  // m^2
  const Matrix6d covariance = TimesArm(match.covariance) + kLeast * Matrix6d::Identity();
  const Matrix6d left = Matrix6d(covariance.inverse()) - match.prior_information;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(left);
  return solver.eigenvectors() * solver.eigenvalues().cwiseMax(0.0).asDiagonal() *
         solver.eigenvectors().transpose();
}

// Other minima in which a match may be instead of its own.
class MinimaBeside {
 public:
  MinimaBeside(const OdometryFrame& frame, const std::vector<PointCluster>& deskewed,
               const VoxelMap& map, const ScanMatcherOptions& options)
      : frame_(frame), deskewed_(deskewed), map_(map), options_(options) {}

  // Whether one lies along the direction that is open most, or along the one that the match knows
  // least.
  bool InMap(const Vector6d& most_open) const {
    constexpr double kBesideM = 0.5;
    return IsOpen(ProfileOf(most_open, nullptr), kBesideM) ||
           IsOpen(ProfileOf(frame_.match.weakest_direction, nullptr), kBesideM);
  }
  // Whether one lies among older planes alone, along a direction that is open by so much.
  bool AmongOlder(const Vector6d& direction, double open_m, const PlanesInstead& older) const {
    // A profile of fewer blocks is flat, whatever clusters say that face the direction slightly.
    constexpr double kFewBlocks = 0.5;
    const DirectionProfile profile = ProfileOf(direction, older);
    return profile.Blocks() >= kFewBlocks && IsOpen(profile, open_m);
  }

 private:
  DirectionProfile ProfileOf(const Vector6d& v, const PlanesInstead& instead) const {
    return {deskewed_, map_, frame_.T_world_lidar, v, instead};
  }
  bool IsOpen(const DirectionProfile& profile, double within_m) const {
    const DirectionProfile::Posterior posterior = profile.With(0.0, within_m);
    return std::hypot(posterior.mean_m, posterior.sigma_m) > options_.max_direction_sigma_m;
  }

  const OdometryFrame& frame_;
  const std::vector<PointCluster>& deskewed_;
  const VoxelMap& map_;
  const ScanMatcherOptions& options_;
};

}  // namespace

void DegenerateStretch::Begin(std::int64_t next_keyframe) {
  open_ = true;
  settled_ = 0;
  told_ = scans_ = 0;
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
    const bool tells = determined && SigmaM() <= matcher_.options().max_direction_sigma_m;
    told_ = tells ? told_ + 1 : 0;
    if (told_ >= (scans_ < kLong ? 1 : 2)) Forget();
    ++scans_;
  }
  any_ = true;
  stamp_ns_ = frame.stamp_ns;
  T_world_lidar_ = frame.T_world_lidar;
}

void DegenerateStretch::StartOver(StampNs stamp_ns, const SE3& T_world_lidar, double gap_s,
                                  double sigma_m, std::int64_t next_keyframe) {
  if (!open_) return;
  Begin(next_keyframe);
  stamp_ns_ = stamp_ns;
  T_world_lidar_ = T_world_lidar;
  // The velocity is that between the last two poses.
  covariance_.diagonal().segment<3>(3).setConstant(sigma_m * sigma_m);
  covariance_.diagonal().segment<3>(9).setConstant(2.0 * sigma_m * sigma_m / (gap_s * gap_s));
}

void DegenerateStretch::Move(const OdometryFrame& frame, const MotionModel& motion,
                             const Matrix6d& measured) {
  constexpr double kLeastS = 1e-3;
  const double dt = std::max(kLeastS, SecondsBetween(stamp_ns_, frame.stamp_ns));
  covariance_.block<6, 6>(6, 6) += TimesArm(motion.VelocityChange(dt));
  // The way that the pose has been moved by, against what was known of the velocity, may be wrong.
  const Vector6d surprise = frame.surprise_m / dt * frame.match.weakest_direction;
  covariance_.block<6, 6>(6, 6) += surprise * surprise.transpose();
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
  const Vector6d most_open = directions.col(5);
  const double open_m = SigmaM();
  const MinimaBeside minima(frame, deskewed, map, o);
  if (open_m > kMinimumM && minima.InMap(most_open)) return;
  OlderPlanes older(map, window, first_keyframe_);
  const PlanesInstead planes = [&](VoxelMap::NodeId surface) { return older.Of(surface); };
  // Most planes of the map were made in the stretch, and have their minimum where it has put it. If
  // the next one is in reach, older planes alone must have theirs there as well.
  if (kLikelySigmas * open_m > kNextMinimumM && minima.AmongOlder(most_open, open_m, planes))
    return;
  const DirectionEvidence evidence =
      matcher_.EvidenceOf(planes, deskewed, frame.T_world_lidar, map, directions);
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
  match->MakeDegenerate();
}

void DegenerateStretch::Archive(StateArchive& a) {
  a(&open_, &settled_, &told_, &scans_, &settled_keyframe_, &first_keyframe_, &any_, &stamp_ns_,
    &T_world_lidar_);
  a.Bytes(covariance_.data(), sizeof(double) * 144);
}

}  // namespace lamina
