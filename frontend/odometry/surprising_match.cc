// Odometry where a match is farther from the prediction than the prediction is unsure.
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/geometry/decompositions.h"
#include "frontend/odometry/odometry.h"

namespace lamina {
namespace {

// Differences in evidence that say nothing.
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

void Odometry::SettleSurprise(const std::vector<PointCluster>& deskewed,
                              const PosePrediction& prediction, const VoxelMap& map, int passes,
                              MatchResult* match) const {
  const auto take = [&](const MatchResult& other) {
    const double more = other.evidence() - match->evidence();
    if (more <= -kAlike || (more <= kAlike && Surprising(other, prediction))) return false;
    *match = other;
    return true;
  };
  // A turn that was not foreseen moves what is far off over to other surfaces; once it is known,
  // the minimum of the way that was foreseen lies near.
  const SE3 turned(match->T_world_lidar.q, prediction.T_world_lidar.t);
  // A wide kernel may carry a match over to the next of several minima in a row.
  const MatchResult narrow = narrow_matcher_.MatchPose(deskewed, prediction, map);
  bool pose_only = take(narrow);
  if (Surprising(*match, prediction) &&
      take(narrow_matcher_.Match(deskewed, prediction, turned, map)))
    pose_only = false;
  if (pose_only && passes == 0)
    *match = narrow_matcher_.Match(deskewed, prediction, match->T_world_lidar, map);
}

void Odometry::SettleSweepSurprise(const std::vector<TimedCluster>& clusters,
                                   const PosePrediction& prediction, const VoxelMap& map,
                                   std::vector<PointCluster>* deskewed,
                                   OdometryFrame* frame) const {
  constexpr int kMostPasses = 6;
  constexpr double kSettledM = 0.005;
  if (motion_.Gap(frame->stamp_ns) > options_.vouched_gap_s) return;
  const auto off_m = [&](const MatchResult& match) {
    return (match.T_world_lidar.t - prediction.T_world_lidar.t).norm();
  };
  OdometryFrame near = *frame;
  near.match.T_world_lidar = prediction.T_world_lidar;
  double moved_m = kSettledM;
  for (int pass = 0; pass < kMostPasses && moved_m >= kSettledM; ++pass) {
    const SE3 from = near.match.T_world_lidar;
    near.sweep = SweepAt(from, *frame);
    DeskewClusters(clusters, near.sweep, deskewed);
    near.match = narrow_matcher_.Match(*deskewed, prediction, from, map);
    if (near.match.status == MatchResult::Status::kTooFewMatches) break;
    moved_m = (near.match.T_world_lidar.t - from.t).norm();
  }
  const double more = near.match.evidence() - frame->match.evidence();
  const bool nearer = off_m(near.match) < off_m(frame->match) - kSettledM;
  if (near.match.status == MatchResult::Status::kTooFewMatches || !nearer || more <= -kAlike) {
    DeskewClusters(clusters, frame->sweep, deskewed);
    return;
  }
  SettleWeakest(clusters, prediction, map, 1, deskewed, &near);
  near.match.covariance += near.acceleration.pose_covariance;
  *frame = near;
}

void Odometry::ReturnToPrediction(const std::vector<TimedCluster>& clusters,
                                  const PosePrediction& prediction, const VoxelMap& map, int passes,
                                  std::vector<PointCluster>* deskewed, OdometryFrame* frame) const {
  const auto vouched = [&](const MatchResult& match) {
    return AsExpected(match, prediction) && !Leaps(match, prediction) &&
           SigmasApart(prediction, match) <= options_.max_prediction_sigmas &&
           match.evidence() >= frame->match.evidence();
  };
  if (lost_ || !motion_.moving_known() || !WithinReach(prediction) ||
      motion_.Gap(frame->stamp_ns) > options_.vouched_gap_s)
    return;
  OdometryFrame near;
  near.stamp_ns = frame->stamp_ns;
  near.T_world_predicted = frame->T_world_predicted;
  near.sweep = motion_.Twist(frame->stamp_ns);
  near.searched = true;
  near.elsewhere = elsewhere_;
  DeskewClusters(clusters, near.sweep, deskewed);
  near.match = narrow_matcher_.Match(*deskewed, prediction, map);
  if (!vouched(near.match)) return;
  MatchDeskewed(clusters, prediction, map, passes, deskewed, &near);
  if (!vouched(near.match)) return;
  near.status = OdometryFrame::Status::kTracked;
  near.T_world_lidar = near.match.T_world_lidar;
  *frame = near;
}

}  // namespace lamina
