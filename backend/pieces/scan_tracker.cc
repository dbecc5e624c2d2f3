#include "backend/pieces/scan_tracker.h"

#include <algorithm>

namespace lamina {
namespace {

void RecallAround(const SE3& T_world_lidar, const std::vector<TimedCluster>& clusters,
                  VoxelMap* map) {
  std::vector<Eigen::Vector3d> points;
  points.reserve(clusters.size());
  for (const TimedCluster& cluster : clusters)
    points.push_back(T_world_lidar * cluster.points.mean);
  map->Recall(points);
}

}  // namespace

ScanTracker::ScanTracker(const MapperOptions& options)
    : odometry_(options.frontend),
      lost_track_(options.frontend, options.map),
      restart_after_lost_frames_(options.backend.restart_after_lost_frames),
      pieces_are_found_(options.pieces_are_found) {}

void ScanTracker::StartAfter(const Trajectory& last) {
  odometry_.StartOver();
  for (const StampedPose& pose : last) odometry_.Accept(pose.stamp_ns, pose.T_world_lidar);
}

void ScanTracker::StartOver() {
  odometry_.StartOver();
  lost_track_.Clear();
}

OdometryFrame ScanTracker::Register(StampNs stamp_ns, bool stamp_made_up,
                                    const std::vector<TimedCluster>& clusters, VoxelMap* map,
                                    bool map_is_older) {
  odometry_.SetStampsRecorded(!stamp_made_up);
  lost_track_.SetStampsRecorded(!stamp_made_up);
  if (odometry_.started()) RecallAround(odometry_.Predict(stamp_ns), clusters, map);
  return odometry_.lost() ? FindAgain(stamp_ns, clusters, *map)
                          : odometry_.Register(stamp_ns, clusters, *map, map_is_older);
}

OdometryFrame ScanTracker::FindAgain(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                                     const VoxelMap& map) {
  // However long the sensor is lost, it more likely keeps its velocity than stands.
  Vector6d twist = odometry_.Twist(stamp_ns);
  twist.tail<3>() = odometry_.velocity().tail<3>();
  lost_track_.Add(stamp_ns, clusters, twist, odometry_.RecentInliers());
  // Scans that agree with no other are searched for until kAlone are lost in a row; those of a
  // track until it has kEach of them, then every kThen-th one.
  constexpr int kAlone = 3, kEach = 8, kThen = 5;
  const std::int64_t scans = lost_track_.scans();
  const bool search = scans > 1 ? scans <= kEach || scans % kThen == 0 : lost_in_a_row_ < kAlone;
  OdometryFrame frame = odometry_.FindAgain(stamp_ns, map, search, &lost_track_);
  if (frame.match.status == MatchResult::Status::kConverged)
    lost_track_.Guess(frame.match.T_world_lidar);
  return frame;
}

void ScanTracker::Accept(const OdometryFrame& frame) {
  lost_in_a_row_ = 0;
  ++tracked_;
  odometry_.Accept(frame);
  if (lost_track_.scans() > 1) odometry_.Assume(lost_track_.Twist(), lost_track_.TwistOverS());
  lost_track_.Clear();
}

void ScanTracker::Lose(const OdometryFrame& frame, const std::vector<TimedCluster>& clusters) {
  if (!odometry_.lost()) lost_track_.Add(frame.stamp_ns, clusters, frame.sweep.twist);
  odometry_.Lose();
  ++lost_in_a_row_;
}

bool ScanTracker::MayRestart(bool matched) const {
  // After spray or a gap a few scans are needed to be found again; if so many agree and are not
  // found, they are not of the map.
  constexpr int kAgreeing = 5;
  const int after = restart_after_lost_frames_;
  // Abandoning a map of a single scan loses nothing, even if the lost scans disagree, as those of a
  // shaken sensor do: another first scan may be less distorted.
  if (!matched) return lost_in_a_row_ >= std::min(kAgreeing, after);
  if (lost_track_.scans() < std::min(kAgreeing, after)) return false;
  if (pieces_are_found_ && !odometry_.InReach(lost_track_.first_stamp_ns())) return true;
  return lost_in_a_row_ > after;
}

bool ScanTracker::LostLongerThanTracked() const {
  return lost_in_a_row_ > std::max<std::int64_t>(restart_after_lost_frames_, tracked_);
}

void ScanTracker::Archive(StateArchive& a) {
  a(&odometry_, &lost_track_, &lost_in_a_row_, &tracked_);
}

}  // namespace lamina
