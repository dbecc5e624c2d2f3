// What WatchDaemon shows on the live page.
#include <utility>
#include <vector>

#include "tools/watch/daemon.h"

namespace lamina {
namespace {

LivePose LivePoseOf(const FinalPose& pose) {
  return {static_cast<std::int64_t>(pose.scan), pose.pose.stamp_ns, pose.pose.T_world_lidar,
          pose.piece};
}

}  // namespace

void WatchDaemon::ShowFinalPose(const FinalPose& pose) {
  if (!pose.skipped) view_.RevisePoses({LivePoseOf(pose)});
}

void WatchDaemon::ShowOpenPoses() {
  if (!view_.PosesWanted()) return;
  std::vector<LivePose> poses;
  session_->mapping().ShowOpenPoses([&](const FinalPose& pose) {
    if (!pose.skipped) poses.push_back(LivePoseOf(pose));
  });
  view_.RevisePoses(poses);
}

void WatchDaemon::ShowScan(const MappedScan& report) {
  ShowOpenPoses();
  if (!view_.ScanWanted() || report.skipped) return;
  LiveScan scan;
  scan.index = static_cast<std::int64_t>(report.index);
  scan.piece = report.piece;
  scan.origin = report.odometry.T_world_lidar.t;
  for (const Eigen::Vector3d& p : session_->mapping().NewestKeyframe()) {
    scan.points.push_back((p - scan.origin).cast<float>());
  }
  view_.SetScan(std::move(scan));
}

void WatchDaemon::ShowStatus(LiveState state) {
  const MappingCounts& counts = session_->mapping().counts();
  const VoxelMap& map = session_->mapping().map();
  LiveStatus status;
  status.state = state;
  status.frames = counts.frames;
  status.keyframes = counts.keyframes;
  status.lost = counts.lost;
  status.degenerate = counts.degenerate;
  status.pieces = counts.pieces;
  status.skipped = counts.scans - counts.frames;
  status.rejected = rejected_;
  status.late = late_;
  status.solves = counts.solves;
  status.failed_solves = counts.failed_solves;
  status.queue = inbox_->waiting();
  status.map_bytes = map.bytes();
  status.map_budget_bytes = static_cast<std::size_t>(map.options().BudgetBytes());
  status.tiles_on_disk = session_->stored_roots();
  status.degenerate_directions = degenerate_directions_;
  status.T_map_world = T_map_world_;
  status.verdict = verdict_.Judge();
  status.failure = room_.wanted();
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    status.checkpoint = checkpoint_;
  }
  view_.SetStatus(std::move(status));
}

}  // namespace lamina
