// Poses that bundle adjustment may still move: those of the keyframes in the window, and of the
// frames that hang on them.
//
// A frame is registered in the middle of its sweep and wanted at its scan's stamp. It keeps its way
// from its keyframe, and moves with that.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>

#include "backend/pieces/scan_tracker.h"
#include "core/geometry/scan.h"
#include "core/geometry/state_archive.h"
#include "core/geometry/sweep_motion.h"

namespace lamina {

class OpenPoses {
 public:
  // Number of the next keyframe.
  std::int64_t NextKeyframe() const {
    return first_id_ + static_cast<std::int64_t>(keyframes_.size());
  }
  bool any_keyframe() const { return !keyframes_.empty(); }
  const SE3& newest_keyframe() const { return keyframes_.back(); }
  void AddKeyframe(const SE3& T_world_lidar) { keyframes_.push_back(T_world_lidar); }
  SE3& Keyframe(std::int64_t id) { return keyframes_[static_cast<std::size_t>(id - first_id_)]; }
  const SE3& Keyframe(std::int64_t id) const {
    return keyframes_[static_cast<std::size_t>(id - first_id_)];
  }
  // Sets the number of the first keyframe; before there is any.
  void CountFrom(std::int64_t keyframe) { first_id_ = keyframe; }
  void ForgetKeyframes() { keyframes_.clear(); }

  // The frame of a scan, on the newest keyframe. The motion during those before is better known
  // now.
  void Add(const MapperScan& scan, const OdometryFrame& frame);
  // Replaces the pose of frame i, and hangs it on the newest keyframe.
  void Set(std::size_t i, const SE3& T_world_lidar, const SweepMotion& sweep);
  // Pose of frame i in the middle of its sweep.
  StampedPose Middle(std::size_t i) const { return MiddleOf(frames_[i]); }
  // Hangs frame i, whose keyframe is gone, on the newest one, at this pose.
  void HangAnew(std::size_t i, const SE3& T_world_lidar);
  // Keyframes have moved: finds the motion during all frames anew.
  void UpdateMotions();
  std::size_t size() const { return frames_.size(); }
  // Time from the stamp of the oldest frame to the middle of its sweep.
  StampNs FirstMiddleNs() const { return frames_.front().middle_ns; }
  // Pose of the oldest frame in the middle of its sweep.
  StampedPose FirstMiddle() const { return MiddleOf(frames_.front()); }

  // Takes the poses, at their stamps, that nothing will move any more: of the frames on keyframes
  // before `first_open`, and of all scans with a number below `before_scan`.
  Trajectory TakeFinal(std::int64_t first_open, std::int64_t before_scan);
  // Poses of all other frames at their stamps, as known now.
  Trajectory AtStamps() const;

  void Archive(StateArchive& a);

 private:
  struct Frame {
    std::int64_t scan = 0;
    StampNs stamp_ns = 0, middle_ns = 0;  // MapperScan
    // The keyframe that it hangs on (itself, if it is one). kNoKeyframe: none, T_keyframe_lidar is
    // T_world_lidar.
    static constexpr std::int64_t kNoKeyframe = -1;
    std::int64_t keyframe_id = kNoKeyframe;
    SE3 T_keyframe_lidar;  // in the middle of the sweep
    SE3 T_middle_stamp;    // what the sensor moved between
    bool of_scan = false;  // SweepMotion
    bool lost = false;     // and no pose is known but the predicted one
  };

  // Finds the motion during frame i from the poses around it. There must be a frame after it.
  void UpdateMotion(std::size_t i);
  // Poses of a frame in the middle of its sweep, and at its stamp.
  StampedPose MiddleOf(const Frame& frame) const;
  StampedPose PoseOf(const Frame& frame) const;

  std::deque<Frame> frames_;
  // Poses of the keyframes in the window, and of those before them on which frames hang.
  std::deque<SE3> keyframes_;
  std::int64_t first_id_ = 0;  // of the first of them
  // The last final poses, at most kMotionNeighbours, in the middle of their sweeps, since the last
  // one that was lost.
  Trajectory left_;
};

}  // namespace lamina
