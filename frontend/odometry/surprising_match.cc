// Odometry where a match is farther from the prediction than the prediction is unsure.
#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/thinning.h"
#include "core/geometry/decompositions.h"
#include "frontend/odometry/odometry.h"

namespace lamina {
namespace {

// Differences in evidence up to this are not significant.
constexpr double kAlike = 0.01;

}  // namespace

double Odometry::SigmasApart(const PosePrediction& prediction, const MatchResult& match) {
  const Vector6d delta = LocalDelta(prediction.T_world_lidar, match.T_world_lidar);
  const Matrix6d both = prediction.covariance + match.covariance;
  return std::sqrt(std::max(0.0, delta.dot(both.ldlt().solve(delta))));
}

bool Odometry::Surprising(const MatchResult& match, const PosePrediction& prediction) const {
  if (match.status == MatchResult::Status::kTooFewMatches || !motion_.moving_known()) return false;
  const double off = (prediction.T_world_lidar.t - match.T_world_lidar.t).norm();
  return off > std::max(kLeastSurpriseM, options_.max_prediction_sigmas * SigmaM(prediction));
}

bool Odometry::Deeper(const MatchResult& other, const MatchResult& match,
                      const PosePrediction& prediction) const {
  if (other.status == MatchResult::Status::kTooFewMatches) return false;
  const double more = other.evidence() - match.evidence();
  return more > kAlike ||
         (more > -kAlike && Surprising(match, prediction) && !Surprising(other, prediction));
}

void Odometry::SettleSurprise(Attempt* attempt) const {
  const PosePrediction& prediction = attempt->prediction;
  MatchResult* const match = &attempt->frame.match;
  const auto take = [&](const MatchResult& other) {
    const bool deeper = Deeper(other, *match, prediction);
    if (deeper) *match = other;
    return deeper;
  };
  const auto from = [&](const SE3& T) {
    return narrow_matcher_.Match(attempt->deskewed, prediction, T, attempt->map);
  };
  // A turn that was not predicted moves distant clusters to other surfaces; once it is known, the
  // minimum at the predicted position is near.
  const SE3 turned(match->T_world_lidar.q, prediction.T_world_lidar.t);
  // A wide kernel may carry a match over to the next of several minima in a row.
  bool pose_only = take(narrow_matcher_.MatchPose(attempt->deskewed, prediction, attempt->map));
  if (Surprising(*match, prediction) && take(from(turned))) pose_only = false;
  if (pose_only && attempt->passes == 0) *match = from(match->T_world_lidar);
}

bool Odometry::MayBeTurned(const MatchResult& match, const PosePrediction& prediction) const {
  // Turns by a voxel at 20 and at 40 m; and least evidence relative to that of the scans before: at
  // the deepest minimum it is about as large, at one beside it 0.76 to 0.91 among trees.
  constexpr double kTurnedRad = Radians(3.0), kDoubtfulRad = Radians(1.5);
  constexpr double kNearlyAsUsual = 0.97, kLess = 0.92;
  if (!options_.search.enabled || lost_ || !motion_.moving_known()) return false;
  if (match.status == MatchResult::Status::kTooFewMatches) return false;
  const double off_rad = RotationAngle(match.T_world_lidar, prediction.T_world_lidar);
  const double fit = MedianOf(recent_fits_);
  const double usual = fit > 0.0 ? RecentInliers() * (1.0 - MatchResult::kChanceFit / fit) : 0.0;
  return (off_rad > kTurnedRad && match.evidence() < kNearlyAsUsual * usual) ||
         (off_rad > kDoubtfulRad && match.evidence() < kLess * usual);
}

void Odometry::SettleTurn(Attempt* attempt) const {
  const PosePrediction& prediction = attempt->prediction;
  MatchResult* const match = &attempt->frame.match;
  PoseHypotheses turns;
  // The error is about as large as the turn away from the prediction.
  PoseSearchOptions reach = options_.search;
  reach.range_deg = std::min(
      reach.range_deg, 0.5 * reach.step_deg +
                           Degrees(RotationAngle(match->T_world_lidar, prediction.T_world_lidar)));
  turns.coarse = TurnsAboutAxes(reach, match->T_world_lidar);
  turns.coarse.emplace_back(motion_.T_world_last().q, prediction.T_world_lidar.t);
  const SearchedScan scan{attempt->deskewed, prediction, attempt->map};
  const MatchResult other = search_.Best(scan, &turns, *match);
  if (!Deeper(other, *match, prediction)) return;
  *match = narrow_matcher_.Match(attempt->deskewed, prediction, other.T_world_lidar, attempt->map);
}

void Odometry::SettleSweepSurprise(Attempt* attempt) const {
  constexpr int kMostPasses = 6;
  constexpr double kSettledM = 0.005;
  const PosePrediction& prediction = attempt->prediction;
  const OdometryFrame& found = attempt->frame;
  if (motion_.Gap(found.stamp_ns) > options_.vouched_gap_s) return;
  const auto off_m = [&](const MatchResult& match) {
    return (match.T_world_lidar.t - prediction.T_world_lidar.t).norm();
  };
  Attempt near = *attempt;
  MatchResult& match = near.frame.match;
  match.T_world_lidar = prediction.T_world_lidar;
  double moved_m = kSettledM;
  for (int pass = 0; pass < kMostPasses && moved_m >= kSettledM; ++pass) {
    const SE3 from = match.T_world_lidar;
    near.Deskew(SweepAt(from, found));
    match = narrow_matcher_.Match(near.deskewed, prediction, from, near.map);
    if (match.status == MatchResult::Status::kTooFewMatches) return;
    moved_m = (match.T_world_lidar.t - from.t).norm();
  }
  const double more = match.evidence() - found.match.evidence();
  const bool nearer = off_m(match) < off_m(found.match) - kSettledM;
  if (!nearer || more <= -kAlike) return;
  SettleWeakest(&near);
  match.covariance += near.frame.acceleration.pose_covariance;
  attempt->Take(std::move(near));
}

void Odometry::FindTurn(const PoseHypotheses& hypotheses, Attempt* attempt) const {
  // Clusters that suffice to choose the turn.
  constexpr std::size_t kClusters = 800;
  // Each pass deskews by the turn that the one before has found.
  constexpr int kPasses = 4;
  // Rates to try, relative to the mean since the last scan: the later the turn begins, the faster
  // it is, and it begins at the latest with this scan.
  constexpr double kShares[] = {1.0, 1.5, 2.0};
  const PosePrediction& prediction = attempt->prediction;
  const double dt = motion_.Gap(attempt->frame.stamp_ns);
  if (lost_ || !motion_.moving_known() || attempt->passes == 0 || dt > options_.vouched_gap_s)
    return;
  const std::vector<TimedCluster> some = Thinned(attempt->clusters, kClusters);
  std::vector<PointCluster> deskewed;
  MatchResult best;
  SweepMotion best_sweep;
  for (const SE3& T : TurnsAboutAxes(options_.search, prediction.T_world_lidar)) {
    for (const double share : kShares) {
      SweepMotion sweep = SweepTo(T, Vector6d::Zero(), dt);
      sweep.twist.head<3>() *= share;
      sweep.of_scan = share != 1.0;
      DeskewClusters(some, sweep, &deskewed);
      const MatchResult match = matcher_.Match(deskewed, prediction, T, attempt->map);
      if (match.status == MatchResult::Status::kTooFewMatches ||
          match.evidence() <= best.evidence())
        continue;
      best = match;
      best_sweep = sweep;
    }
  }
  if (best.status == MatchResult::Status::kTooFewMatches) return;
  Attempt turned = attempt->Anew(kPasses);
  OdometryFrame& frame = turned.frame;
  turned.Deskew(best_sweep);
  frame.match = matcher_.Match(turned.deskewed, prediction, best.T_world_lidar, turned.map);
  MatchDeskewed(&turned);
  SearchedScan scan{turned.deskewed, prediction, turned.map, false};
  scan.timed = true;
  Judge(scan, hypotheses, &frame);
  if (frame.status == OdometryFrame::Status::kTracked) attempt->Take(std::move(turned));
}

void Odometry::ReturnToPrediction(Attempt* attempt) const {
  const PosePrediction& prediction = attempt->prediction;
  const OdometryFrame& found = attempt->frame;
  const auto vouched = [&](const MatchResult& match) {
    return AsExpected(match, prediction) && !Leaps(match, prediction) &&
           SigmasApart(prediction, match) <= options_.max_prediction_sigmas &&
           match.evidence() >= found.match.evidence();
  };
  if (lost_ || !motion_.moving_known() || !WithinReach(prediction) ||
      motion_.Gap(found.stamp_ns) > options_.vouched_gap_s)
    return;
  Attempt near = attempt->Anew(attempt->passes);
  OdometryFrame& frame = near.frame;
  frame.elsewhere = elsewhere_;
  near.Deskew(motion_.Twist(found.stamp_ns));
  frame.match = narrow_matcher_.Match(near.deskewed, prediction, near.map);
  if (!vouched(frame.match)) return;
  MatchDeskewed(&near);
  if (!vouched(frame.match)) return;
  frame.status = OdometryFrame::Status::kTracked;
  frame.T_world_lidar = frame.match.T_world_lidar;
  attempt->Take(std::move(near));
}

}  // namespace lamina
