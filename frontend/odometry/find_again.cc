// Odometry of a sensor that is lost: its track is looked for in the map.
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/angle.h"
#include "frontend/odometry/lost_track.h"
#include "frontend/odometry/odometry.h"

namespace lamina {

PosePrediction Odometry::PredictTrack(const LostTrack& track) const {
  PosePrediction prediction = motion_.Predict(track.first_stamp_ns());
  const SE3 T_first_newest = track.T_first_newest();
  const double turn2 = std::min(prediction.covariance.diagonal().head<3>().maxCoeff(),
                                std::pow(Radians(options_.search.range_deg), 2));
  prediction.covariance.diagonal().tail<3>().array() += turn2 * T_first_newest.t.squaredNorm();
  prediction.T_world_lidar = prediction.T_world_lidar * T_first_newest;
  return prediction;
}

void Odometry::SearchTogether(const SearchedScan& scan, PoseHypotheses* hypotheses,
                              OdometryFrame* frame) const {
  frame->searched = options_.search.enabled;
  frame->match = matcher_.MatchPose(scan.clusters, scan.prediction, scan.map);
  if (frame->searched) {
    *hypotheses = Hypotheses(scan.prediction, false);
    frame->match = search_.Best(scan, hypotheses, frame->match);
  }
  frame->match =
      matcher_.Match(scan.clusters, scan.prediction, frame->match.T_world_lidar, scan.map);
}

bool Odometry::SettleNewest(const LostTrack& track, const PosePrediction& prediction,
                            const VoxelMap& map, OdometryFrame* frame) const {
  // Two scans with little overlap drift against each other by less than this.
  constexpr double kSlidM = 0.5;
  if (track.scans() < 2 || frame->status != OdometryFrame::Status::kTracked) return false;
  const MatchResult alone =
      matcher_.Match(track.Newest(), prediction, frame->match.T_world_lidar, map);
  if (alone.status != MatchResult::Status::kConverged || alone.fit() < LostTrack::kLeastFit ||
      alone.worst_sigma_m > options_.max_tracked_sigma_m ||
      (alone.T_world_lidar.t - frame->T_world_lidar.t).norm() > kSlidM)
    return false;
  frame->match = alone;
  frame->T_world_lidar = alone.T_world_lidar;
  return true;
}

OdometryFrame Odometry::FindAgain(StampNs stamp_ns, const VoxelMap& map, bool search,
                                  LostTrack* track) const {
  OdometryFrame frame;
  frame.stamp_ns = stamp_ns;
  frame.status = OdometryFrame::Status::kLost;
  for (bool straight = false;; straight = true) {
    const PosePrediction prediction = PredictTrack(*track);
    frame.T_world_predicted = frame.T_world_lidar = prediction.T_world_lidar;
    frame.sweep = track->Twist();
    if (!search) return frame;
    const std::vector<PointCluster> clusters = track->Together();
    SearchedScan scan{clusters, prediction, map, false};
    PoseHypotheses hypotheses;
    SearchTogether(scan, &hypotheses, &frame);
    if (!straight && frame.match.status != MatchResult::Status::kTooFewMatches &&
        track->Straighten({frame.match.T_world_lidar, prediction.covariance}, map,
                          options_.lost_inlier_ratio * RecentInliers()))
      continue;
    constexpr int kAgreeing = 2;
    scan.agreed = WhereMotionLeads(frame.match, prediction) ||
                  track->Guessed(frame.match.T_world_lidar) >= kAgreeing;
    Judge(scan, hypotheses, &frame);
    const bool alone = SettleNewest(*track, prediction, map, &frame);
    DoubtUnbridged(prediction, alone ? track->Newest() : clusters, map, &frame);
    return frame;
  }
}

}  // namespace lamina
