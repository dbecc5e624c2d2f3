#include "frontend/odometry/shaken_sweep.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "core/base/angle.h"
#include "core/base/parallel.h"
#include "core/base/thinning.h"
#include "core/geometry/degeneracy.h"
#include "frontend/matching/block_votes.h"
#include "frontend/matching/map_residuals.h"
#include "frontend/matching/plane_score.h"
#include "frontend/odometry/sweep_acceleration.h"
#include "frontend/scan/scan_clusters.h"

namespace lamina {
namespace {

// Kernel scale of each step, in standard deviations: from far off on a part of the clusters, then
// on all.
constexpr double kFromAfar[] = {60.0, 60.0, 60.0, 30.0, 30.0, 20.0, 12.0, 12.0, 6.0, 6.0};
constexpr double kNear[] = {12.0, 6.0, 4.0, 2.0, 2.0, 2.0};

// How the clusters of a scan lie on a map.
struct Explanation {
  const std::vector<PointCluster>& deskewed;
  const SE3& T_world_lidar;
};

// Whether `ours` is so much better that it is neither chance nor a thing that moves.
bool ClearlyBetter(const Explanation& ours, const Explanation& theirs,
                   const std::vector<TimedCluster>& timed, const VoxelMap& map, double scale_m) {
  // Least mean gain in weights in [0, 1], and its least significance. By a motion that it does not
  // have a hand-held sensor's scan gains 0.01, at most 0.06, and in a room of a dozen blocks the
  // votes, being those of the clusters that were fitted, come to 3 standard deviations at most.
  constexpr double kLeastGain = 0.05, kLeastSigmas = 3.0;
  const PlaneScore our_score(ours.T_world_lidar, map, scale_m, MatchResult::kChanceFit);
  const PlaneScore their_score(theirs.T_world_lidar, map, scale_m, MatchResult::kChanceFit);
  BlockDifferences differences;
  double sum = 0.0;
  int met = 0;
  for (std::size_t i = 0; i < timed.size(); ++i) {
    const double a = our_score.Of(ours.deskewed[i]), b = their_score.Of(theirs.deskewed[i]);
    if (!(std::max(a, b) > PlaneScore::kNone)) continue;
    const double difference = PlaneScore::OrNothing(a) - PlaneScore::OrNothing(b);
    differences.Add(timed[i].points.mean, difference);
    sum += difference;
    ++met;
  }
  return met > 0 && sum > kLeastGain * met && differences.Sigmas() > kLeastSigmas;
}

// Normal equations of pose (scaled tangent) and [a; b] (body).
struct JointEquations {
  Matrix6d H_pose = Matrix6d::Zero();
  Eigen::Matrix<double, 6, 12> H_across = Eigen::Matrix<double, 6, 12>::Zero();
  Eigen::Matrix<double, 12, 12> H_other = Eigen::Matrix<double, 12, 12>::Zero();
  Vector6d g_pose = Vector6d::Zero();
  Eigen::Matrix<double, 12, 1> g_other = Eigen::Matrix<double, 12, 1>::Zero();
};

JointEquations EquationsAt(const std::vector<TimedCluster>& timed, const SE3& T, double gap_s,
                           double kernel_sigma, MapResiduals* residuals) {
  std::vector<StepShares> pose_a(timed.size()), pose_b(timed.size()), a_b(timed.size());
  for (std::size_t i = 0; i < timed.size(); ++i) {
    const double g_b = timed[i].mean_time_s * gap_s;
    pose_a[i] = SharesOf(timed[i], gap_s);
    pose_b[i] = {pose_a[i].pose, g_b};
    a_b[i] = {pose_a[i].other, g_b};
  }
  const TwoStepRows a = residuals->TwoStepsAt(T, kernel_sigma, pose_a);
  const TwoStepRows b = residuals->TwoStepsAt(T, kernel_sigma, pose_b);
  const Matrix6d across = residuals->TwoStepsAt(T, kernel_sigma, a_b).across.H();
  const Matrix6d to = BodyToTangent(T);
  const auto in_body = [&](const Matrix6d& H) {
    return Matrix6d(to.transpose() * DividedByArm(H) * to);
  };
  JointEquations eq;
  eq.H_pose = DividedByArm(a.pose.H());
  eq.g_pose = DividedByArm(a.pose.g());
  eq.H_across << DividedByArm(a.across.H()) * to, DividedByArm(b.across.H()) * to;
  eq.H_other << in_body(a.other.H()), in_body(across), in_body(across), in_body(b.other.H());
  eq.g_other << to.transpose() * DividedByArm(a.other.g()),
      to.transpose() * DividedByArm(b.other.g());
  return eq;
}

}  // namespace

UnsteadyMotion UnsteadyPart(const SweepMotion& sweep, const SE3& T_world_last,
                            const SE3& T_world_lidar, double gap_s) {
  const Vector6d mean = MeanTwist(T_world_last, T_world_lidar, gap_s);
  UnsteadyMotion unsteady;
  unsteady << sweep.acceleration, (sweep.twist - mean) / gap_s - 0.5 * sweep.acceleration;
  return unsteady;
}

ShakenSweep::ShakenSweep(const ScanMatcherOptions& matcher, const MotionOptions& motion)
    : options_(matcher), matcher_(WithNarrowKernel(matcher)) {
  // Accelerations of a shaken sensor relative to those of the motion options, and the change within
  // a scan relative to that.
  constexpr double kShaken = 3.0, kChange = 1.0 / 3.0;
  Vector6d sigma;
  sigma << Eigen::Vector3d::Constant(kShaken * Radians(motion.turn_acceleration_sigma_deg_s2)),
      Eigen::Vector3d::Constant(kShaken * motion.acceleration_sigma_m_s2);
  information_ << sigma.cwiseAbs2().cwiseInverse(), (kChange * sigma).cwiseAbs2().cwiseInverse();
  const Vector6d expected = (sigma / kShaken).cwiseAbs2();
  ordinary_ << expected, (2.0 / 36.0) * expected;
}

bool ShakenSweep::Suspected(const ShakenScan& scan, const MatchResult& match) const {
  constexpr double kGoodFit = 0.85, kOffRad = Radians(0.5), kMostGaps = 1.2;
  if (!(scan.gap_s > 0.0) || match.fit() > kGoodFit) return false;
  if (!scan.starting && RotationAngle(match.T_world_lidar, scan.prediction.T_world_lidar) < kOffRad)
    return false;
  return SweepLength(scan.clusters) < kMostGaps * scan.gap_s;
}

SweepMotion ShakenSweep::MotionOf(const ShakenScan& scan, const State& state) const {
  const Vector6d mean = MeanTwist(scan.T_world_last, state.T_world_lidar, scan.gap_s);
  SweepMotion motion = SweepMotion::WithMean(mean + scan.gap_s * state.unsteady.tail<6>(),
                                             scan.gap_s, state.unsteady.head<6>());
  motion.of_scan = true;
  return motion;
}

bool ShakenSweep::Step(const ShakenScan& scan, const std::vector<TimedCluster>& clusters,
                       double kernel_sigma, std::vector<PointCluster>* deskewed,
                       State* state) const {
  DeskewClusters(clusters, MotionOf(scan, *state), deskewed);
  MapResiduals residuals(options_, scan.map, *deskewed);
  const JointEquations eq =
      EquationsAt(clusters, state->T_world_lidar, scan.gap_s, kernel_sigma, &residuals);
  if (!(eq.H_pose.trace() > 0.0)) return false;
  const Matrix6d damped = eq.H_pose + 1e-9 * eq.H_pose.trace() * Matrix6d::Identity();
  const Matrix6d inverse = damped.ldlt().solve(Matrix6d::Identity());
  const Eigen::Matrix<double, 6, 12> moved = inverse * eq.H_across;
  Matrix12d information = kCountingShare * (eq.H_other - eq.H_across.transpose() * moved);
  information.diagonal() += information_;
  state->covariance = information.ldlt().solve(Matrix12d::Identity());
  const UnsteadyMotion change =
      -state->covariance * (kCountingShare * (eq.g_other - moved.transpose() * eq.g_pose) +
                            information_.cwiseProduct(state->unsteady));
  const Vector6d step = -inverse * eq.g_pose - moved * change;
  if (!change.allFinite() || !step.allFinite()) return false;
  // Associations are good for about a voxel, and so is the length of a step.
  const double share = std::min(1.0, 0.5 * scan.map.options().root_size_m / step.norm());
  state->T_world_lidar = Retract(state->T_world_lidar, DividedByArm(Vector6d(share * step)));
  state->unsteady += share * change;
  state->pose_covariance = DividedByArm(Matrix6d(moved * state->covariance * moved.transpose()));
  return true;
}

std::vector<SE3> ShakenSweep::Starts(const ShakenScan& scan, const MatchResult& match) const {
  const SE3& predicted = scan.prediction.T_world_lidar;
  // A shaken sensor turns back: the last orientation is a start as well.
  std::vector<SE3> starts = {predicted, SE3(scan.T_world_last.q, predicted.t)};
  if (match.status != MatchResult::Status::kTooFewMatches) starts.push_back(match.T_world_lidar);
  if (!scan.starting) return starts;
  // Descents with a wide kernel reach this far.
  constexpr int kReach = 3;
  constexpr double kStepM = 1.0;
  for (int x = -kReach; x <= kReach; ++x) {
    for (int y = -kReach; y <= kReach; ++y) {
      if (x * x + y * y > kReach * kReach) continue;
      starts.emplace_back(predicted.q, predicted * (kStepM * Eigen::Vector3d(x, y, 0.0)));
    }
  }
  return starts;
}

ShakenSweep::State ShakenSweep::BestOf(const ShakenScan& scan,
                                       const std::vector<SE3>& starts) const {
  constexpr std::size_t kClusters = 400;
  constexpr double kScaleM = 0.1;
  std::vector<TimedCluster> part;
  const std::size_t stride = StrideToAtLeast(scan.clusters.size(), kClusters);
  for (std::size_t i = 0; i < scan.clusters.size(); i += stride) part.push_back(scan.clusters[i]);
  std::vector<State> ends(starts.size());
  std::vector<double> scores(starts.size(), -1.0);
  ParallelChunks(starts.size(), 1, [&](std::size_t begin, std::size_t end) {
    std::vector<PointCluster> deskewed;
    for (std::size_t i = begin; i < end; ++i) {
      ends[i].T_world_lidar = starts[i];
      bool met = true;
      for (const double kernel : kFromAfar)
        met = met && Step(scan, part, kernel, &deskewed, &ends[i]);
      if (!met) continue;
      DeskewClusters(part, MotionOf(scan, ends[i]), &deskewed);
      scores[i] = matcher_.Score(deskewed, ends[i].T_world_lidar, scan.map, kScaleM, 1,
                                 MatchResult::kChanceFit);
    }
  });
  return ends[static_cast<std::size_t>(std::max_element(scores.begin(), scores.end()) -
                                       scores.begin())];
}

bool ShakenSweep::Possible(const State& state, bool goes_on) const {
  // A shake that is known to go on may have twice the accelerations.
  const double kMost = goes_on ? 240.0 : 60.0;
  return state.unsteady.dot(information_.cwiseProduct(state.unsteady)) < kMost;
}

bool ShakenSweep::Unexpected(const State& state) const {
  // One in 400 by the distribution of chi^2 with 12 degrees of freedom; generated scenes have less
  // than 3 where the sensor is not shaken, and more than 37 where it is.
  constexpr double kLeast = 30.0;
  Matrix12d covariance = state.covariance;
  covariance.diagonal() += ordinary_;
  const double off2 = state.unsteady.dot(covariance.ldlt().solve(state.unsteady));
  return off2 > kLeast && Possible(state, false);
}

Matrix6d ShakenSweep::Unmodelled(const ShakenScan& scan, const State& state) const {
  constexpr double kShare = 0.05;
  const double t2 = scan.gap_s * scan.gap_s;
  const Vector6d a = state.unsteady.head<6>(), b = state.unsteady.tail<6>();
  const Vector6d most = kShare * t2 * (0.125 * a.cwiseAbs() + 0.5 * b.cwiseAbs());
  Matrix6d covariance = most.cwiseAbs2().asDiagonal();
  const Eigen::Matrix3d R = state.T_world_lidar.R();
  covariance.bottomRightCorner<3, 3>() = R * covariance.bottomRightCorner<3, 3>() * R.transpose();
  return covariance;
}

bool ShakenSweep::Find(const ShakenScan& scan, std::vector<PointCluster>* deskewed,
                       MatchResult* match, SweepMotion* sweep, Matrix6d* pose_covariance) const {
  const std::vector<PointCluster> ordinary = *deskewed;
  State state;
  if (sweep->of_scan) {
    state.T_world_lidar = match->T_world_lidar;
    state.unsteady = UnsteadyPart(*sweep, scan.T_world_last, state.T_world_lidar, scan.gap_s);
  } else {
    state = BestOf(scan, Starts(scan, *match));
  }
  for (const double kernel : kNear) {
    if (!Step(scan, scan.clusters, std::max(kernel, options_.kernel_end_sigma), deskewed, &state))
      return false;
  }
  const SweepMotion motion = MotionOf(scan, state);
  DeskewClusters(scan.clusters, motion, deskewed);
  const MatchResult found =
      matcher_.Match(*deskewed, scan.prediction, state.T_world_lidar, scan.map);
  if (found.status == MatchResult::Status::kTooFewMatches) return false;
  if (sweep->of_scan) {
    if (found.evidence() < match->evidence()) return false;
  } else {
    const double scale_m = options_.kernel_end_sigma * scan.map.options().noise_floor_m;
    const Explanation ours{*deskewed, found.T_world_lidar}, theirs{ordinary, match->T_world_lidar};
    // At the start this is the difference of two scans' motions, with twice the variance.
    State each = state;
    if (scan.starting) {
      each.unsteady *= M_SQRT1_2;
      each.covariance *= 0.5;
    }
    const bool goes_on = scan.goes_on && Possible(state, true);
    if (!(goes_on || Unexpected(each)) ||
        !ClearlyBetter(ours, theirs, scan.clusters, scan.map, scale_m))
      return false;
  }
  *match = found;
  *sweep = motion;
  *pose_covariance = state.pose_covariance + Unmodelled(scan, state);
  return true;
}

}  // namespace lamina
