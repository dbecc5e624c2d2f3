#include "frontend/odometry/lost_track.h"

#include <algorithm>
#include <utility>

#include "frontend/odometry/odometry.h"
#include "frontend/scan/scan_clusters.h"

namespace lamina {

LostTrack::LostTrack(const OdometryOptions& options, const VoxelMapOptions& map_options)
    : matcher_(options.matcher), map_options_(map_options), motion_(options.motion) {}

void LostTrack::Add(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                    const Vector6d& twist, double usual_inliers) {
  Scan scan;
  if (scans_ > 0 && Agrees(stamp_ns, clusters, usual_inliers, &scan)) {
    motion_.Accept(stamp_ns, scan.T_first_lidar, true);
  } else {
    Clear();
    motion_.Accept(stamp_ns, SE3(), false);
    motion_.Assume(twist);
    first_stamp_ns_ = stamp_ns;
    scan.clusters = DeskewClusters(clusters, twist);
  }
  ++scans_;
  kept_.push_back(std::move(scan));
  if (kept_.size() > kKept) kept_.pop_front();
}

void LostTrack::Clear() {
  kept_.clear();
  scans_ = 0;
  guesses_ = 0;
}

int LostTrack::Guessed(const SE3& T_world_newest) const {
  constexpr double kSameM = 0.5, kSameRad = 0.03;
  const SE3 T_world_first = T_world_newest * T_first_newest().Inverse();
  const bool same = (T_world_first.t - T_world_first_guess_.t).norm() < kSameM &&
                    RotationAngle(T_world_first, T_world_first_guess_) < kSameRad;
  return same ? guesses_ : 0;
}

void LostTrack::Guess(const SE3& T_world_newest) {
  guesses_ = Guessed(T_world_newest) + 1;
  T_world_first_guess_ = T_world_newest * T_first_newest().Inverse();
}

bool LostTrack::Agrees(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                       double usual_inliers, Scan* scan) const {
  // One scan of few rings has little of what the next one sees, however well they agree.
  constexpr double kLeastFit = 0.7, kLeastOverlap = 0.3, kLeastOverlapOfTwo = 0.18;
  // Of a forest, in which scans lie on planes by a fifth, two have half as much in common that are
  // right, and a third where they are not.
  constexpr double kLeastOfUsual = 0.5;
  const double usual = usual_inliers > 0.0 ? kLeastOfUsual * usual_inliers : 1.0;
  const double least_overlap =
      std::min(kept_.size() > 1 ? kLeastOverlap : kLeastOverlapOfTwo, usual);
  VoxelMap map(map_options_);
  std::int64_t frame = 0;
  for (const Scan& other : kept_) {
    for (const PointCluster& cluster : other.clusters) {
      const PointCluster moved = cluster.Moved(other.T_first_lidar);
      if (map.CanHold(moved.mean)) map.AddWindow(map.LeafAt(moved.mean), moved, frame);
    }
    ++frame;
  }
  map.Refresh();
  const PosePrediction prediction = motion_.Predict(stamp_ns);
  Vector6d twist = motion_.Twist(stamp_ns);
  MatchResult match = matcher_.MatchPose(DeskewClusters(clusters, twist), prediction, map);
  if (match.status == MatchResult::Status::kTooFewMatches || match.fit() < kLeastFit ||
      match.overlap() < least_overlap)
    return false;
  const double dt = motion_.Gap(stamp_ns);
  if (dt > 0.0) twist = TwistLog(motion_.T_world_last().Inverse() * match.T_world_lidar) / dt;
  scan->T_first_lidar = match.T_world_lidar;
  scan->clusters = DeskewClusters(clusters, twist);
  return true;
}

Vector6d LostTrack::Twist() const { return motion_.velocity(); }

std::vector<PointCluster> LostTrack::Together() const {
  std::vector<TimedCluster> all;
  for (const Scan& scan : kept_) {
    const SE3 T_newest_lidar = T_first_newest().Inverse() * scan.T_first_lidar;
    for (const PointCluster& cluster : scan.clusters) {
      all.emplace_back();
      all.back().points = cluster.Moved(T_newest_lidar);
    }
  }
  if (kept_.size() > 1) all = MergeClusters(all, map_options_.LeafSize());
  return DeskewClusters(all, SweepMotion());
}

void LostTrack::Archive(StateArchive& a) {
  a(&motion_, &scans_, &first_stamp_ns_, &T_world_first_guess_, &guesses_);
  kept_.resize(a.Size(kept_.size(), 1));
  for (Scan& scan : kept_) a(&scan.T_first_lidar, &scan.clusters);
}

}  // namespace lamina
