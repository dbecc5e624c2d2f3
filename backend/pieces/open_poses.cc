#include "backend/pieces/open_poses.h"

#include <algorithm>

#include "backend/pieces/sweep_stamp.h"
#include "frontend/odometry/motion_model.h"

namespace lamina {

void OpenPoses::Add(const MapperScan& scan, const OdometryFrame& frame) {
  frames_.push_back({scan.number, scan.stamp_ns, scan.middle_ns, Frame::kNoKeyframe,
                     frame.T_world_lidar, AtStamp(frame.sweep, scan.middle_ns), false,
                     frame.status == OdometryFrame::Status::kLost});
  if (any_keyframe()) Set(frames_.size() - 1, frame.T_world_lidar, frame.sweep);
  if (frame.status != OdometryFrame::Status::kTracked) return;
  // Two poses after a frame tell of the motion during it.
  for (std::size_t after = std::min<std::size_t>(2, frames_.size() - 1); after > 0; --after)
    UpdateMotion(frames_.size() - 1 - after);
}

void OpenPoses::UpdateMotions() {
  for (std::size_t i = 0; i + 1 < frames_.size(); ++i) UpdateMotion(i);
}

void OpenPoses::UpdateMotion(std::size_t i) {
  Frame& frame = frames_[i];
  if (frame.of_scan || frame.lost || frames_[i + 1].lost) return;
  // A lost scan is where it was expected, which tells nothing of the motion beside it.
  Trajectory before;
  for (std::size_t k = i; k > 0 && before.size() < kMotionNeighbours && !frames_[k - 1].lost; --k)
    before.insert(before.begin(), MiddleOf(frames_[k - 1]));
  if (before.size() == i) before.insert(before.begin(), left_.begin(), left_.end());
  Trajectory poses = before;
  for (std::size_t k = i; k < frames_.size() && k <= i + kMotionNeighbours; ++k) {
    if (frames_[k].lost) break;
    poses.push_back(MiddleOf(frames_[k]));
  }
  SweepMotion motion;
  if (MotionThrough(poses, before.size(), MotionModel::kMotionOfS, &motion))
    frame.T_middle_stamp = AtStamp(motion, frame.middle_ns);
}

void OpenPoses::HangAnew(std::size_t i, const SE3& T_world_lidar) {
  frames_[i].keyframe_id = NextKeyframe() - 1;
  frames_[i].T_keyframe_lidar = newest_keyframe().Inverse() * T_world_lidar;
}

void OpenPoses::Set(std::size_t i, const SE3& T_world_lidar, const SweepMotion& sweep) {
  HangAnew(i, T_world_lidar);
  Frame& frame = frames_[i];
  frame.T_middle_stamp = AtStamp(sweep, frame.middle_ns);
  frame.of_scan = sweep.of_scan;
}

StampedPose OpenPoses::MiddleOf(const Frame& frame) const {
  const StampNs stamp_ns = frame.stamp_ns + frame.middle_ns;
  if (frame.keyframe_id == Frame::kNoKeyframe) return {stamp_ns, frame.T_keyframe_lidar};
  return {stamp_ns, Keyframe(frame.keyframe_id) * frame.T_keyframe_lidar};
}

StampedPose OpenPoses::PoseOf(const Frame& frame) const {
  return {frame.stamp_ns, MiddleOf(frame).T_world_lidar * frame.T_middle_stamp};
}

Trajectory OpenPoses::TakeFinal(std::int64_t first_open, std::int64_t before_scan) {
  Trajectory trajectory;
  while (!frames_.empty() &&
         (frames_.front().keyframe_id < first_open || frames_.front().scan < before_scan)) {
    const Frame& oldest = frames_.front();
    trajectory.push_back(PoseOf(oldest));
    if (oldest.lost) {
      left_.clear();
    } else {
      AddNeighbour(MiddleOf(oldest), &left_);
    }
    frames_.pop_front();
  }
  if (keyframes_.empty()) return trajectory;
  const std::int64_t needed =
      frames_.empty() ? first_open : std::min(first_open, frames_.front().keyframe_id);
  for (; first_id_ < needed; ++first_id_) keyframes_.pop_front();
  return trajectory;
}

Trajectory OpenPoses::AtStamps() const {
  Trajectory trajectory;
  for (const Frame& frame : frames_) trajectory.push_back(PoseOf(frame));
  return trajectory;
}

void OpenPoses::Archive(StateArchive& a) {
  a(&keyframes_, &first_id_, &left_);
  frames_.resize(a.Size(frames_.size(), 1));
  for (Frame& frame : frames_) {
    a(&frame.scan, &frame.stamp_ns, &frame.middle_ns, &frame.keyframe_id, &frame.T_keyframe_lidar,
      &frame.T_middle_stamp, &frame.of_scan, &frame.lost);
  }
}

}  // namespace lamina
