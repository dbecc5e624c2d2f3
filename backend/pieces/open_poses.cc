#include "backend/pieces/open_poses.h"

#include <algorithm>

#include "backend/pieces/sweep_stamp.h"
#include "backend/window/sliding_window.h"

namespace lamina {

void OpenPoses::Add(const MapperScan& scan, const OdometryFrame& frame) {
  frames_.push_back({scan.number, scan.stamp_ns, scan.middle_ns, Frame::kNoKeyframe,
                     frame.T_world_lidar, AtStamp(frame.sweep, scan.middle_ns), false,
                     frame.status == OdometryFrame::Status::kLost});
  if (any_keyframe()) Set(frames_.size() - 1, frame.T_world_lidar, frame.sweep);
  if (frame.status != OdometryFrame::Status::kTracked) return;
  // A lost scan is where it was expected, which tells nothing of the motion to the next one.
  std::size_t begin = frames_.size() - 1;
  while (begin > 0 && frames_.size() - begin < 3 && !frames_[begin - 1].lost) --begin;
  if (frames_.size() - begin < 2) return;
  Trajectory poses;
  for (std::size_t k = begin; k < frames_.size(); ++k) poses.push_back(MiddleOf(frames_[k]));
  const auto settle = [&](std::size_t k) {
    SweepMotion motion;
    if (frames_[k].of_scan) return;
    if (MotionThrough(poses, k - begin, SlidingWindow::kMaxTwistGapS, &motion))
      frames_[k].T_middle_stamp = AtStamp(motion, frames_[k].middle_ns);
  };
  settle(frames_.size() - 2);
  // The first of all has no pose before it, and is known better by the two after it.
  if (frames_.size() == 3 && begin == 0) settle(0);
}

void OpenPoses::Set(std::size_t i, const SE3& T_world_lidar, const SweepMotion& sweep) {
  Frame& frame = frames_[i];
  frame.keyframe_id = NextKeyframe() - 1;
  frame.T_keyframe_lidar = newest_keyframe().Inverse() * T_world_lidar;
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
    trajectory.push_back(PoseOf(frames_.front()));
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
  a(&keyframes_, &first_id_);
  frames_.resize(a.Size(frames_.size(), 1));
  for (Frame& frame : frames_) {
    a(&frame.scan, &frame.stamp_ns, &frame.middle_ns, &frame.keyframe_id, &frame.T_keyframe_lidar,
      &frame.T_middle_stamp, &frame.of_scan, &frame.lost);
  }
}

}  // namespace lamina
