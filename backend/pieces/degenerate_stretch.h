// What a stretch of scans that were degenerate leaves unknown of the poses after it.
//
// A pose that is held along a direction is where the prediction has it, and the next one begins
// there: errors add up until the sensor sees again what tells the direction. What it sees then may
// have entered the map in the stretch itself. Such planes hold the pose to what the stretch made of
// it, and a scan that matches them well is as wrong against the map from before as they are.
//
// Followed is the error x of the pose against the map from before the stretch, and that of the
// velocity, v (scaled tangent of core/geometry/degeneracy.h, per second), by a Kalman filter of
// their covariance alone. From scan to scan, dt apart,
//
//     v' = v + a dt,    x' = F x + v' dt,
//
// a dt being what the velocity may differ by (MotionModel::VelocityChange) and F what a turned pose
// makes of the way to the next one. Where a match has left its prediction by s along u, more than
// both explain (OdometryFrame::surprise_m), v' is open by s/dt along u as well. A match tells of v'
// dt what its covariance says without the prediction's share, M = C^-1 - (prior information); along
// directions that what is older than the stretch determines (older_planes.h) it tells of x' as
// well. Where x is open by more than a minimum is wide, the match may have found a wrong one: then
// it tells of x' only if the profile (direction_profile.h) shows no other beside it, neither in the
// map nor, where another is in reach, among the older planes alone. A stretch ends with a scan
// that determines all directions with x known, or with the second one in a row if it is long: until
// then scans stay degenerate.
#pragma once

#include <cstdint>
#include <vector>

#include "backend/window/sliding_window.h"
#include "core/geometry/scan.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"
#include "frontend/odometry/motion_model.h"
#include "frontend/odometry/odometry_frame.h"
#include "frontend/odometry/odometry_options.h"

namespace lamina {

// Not thread-safe; deterministic.
class DegenerateStretch {
 public:
  explicit DegenerateStretch(const OdometryOptions& options) : matcher_(options.matcher) {}

  // A frame, before its scan enters the map and its pose the motion model; `next_keyframe` is the
  // number of the next keyframe.
  void Follow(const OdometryFrame& frame, const MotionModel& motion,
              const std::vector<TimedCluster>& clusters, const VoxelMap& map,
              const SlidingWindow& window, std::int64_t next_keyframe);

  // Restarts an open stretch after the scans so far got new poses, by all of them together: the
  // pose of the newest, and the standard deviation of each along each axis. All that has been
  // mapped from here on counts as made in the stretch.
  void StartOver(StampNs stamp_ns, const SE3& T_world_lidar, double gap_s, double sigma_m,
                 std::int64_t next_keyframe);

  // Standard deviation of the newest pose against what was mapped before, along the direction that
  // is known least. 0 if there is no stretch.
  double SigmaM() const;
  // Whether scans determine all directions again, but none sees enough of what was mapped before,
  // so that what is unknown stays so.
  bool over() const { return open_ && settled_ >= kSettled; }
  // The first keyframe of these scans, if one of them became one.
  std::int64_t settled_keyframe() const { return settled_keyframe_; }
  void Forget() { open_ = false; }
  // The match of the newest frame, as one with the map from before the stretch: with what that
  // leaves unknown in its covariance, and degenerate as long as the stretch goes on.
  void Widen(MatchResult* match) const;

  void Archive(StateArchive& a);

 private:
  using Matrix12d = Eigen::Matrix<double, 12, 12>;

  void Begin(std::int64_t next_keyframe);
  void Move(const OdometryFrame& frame, const MotionModel& motion, const Matrix6d& measured);
  // Takes in information about a block of the state: x (0) or v (6).
  void Learn(int block, const Matrix6d& information);
  void Compare(const OdometryFrame& frame, const std::vector<TimedCluster>& clusters,
               const VoxelMap& map, const SlidingWindow& window, const Matrix6d& measured);

  // Scans that must determine all directions in a row: the next one may see the map from before.
  static constexpr int kSettled = 5;
  // A stretch of so many scans is long. After it one scan alone may be determined by chance: in
  // adverse scenes the first one was wrong ten times as often as the sixth.
  static constexpr int kLong = 2;

  ScanMatcher matcher_;
  bool open_ = false;
  int settled_ = 0;
  int told_ = 0;   // newest scans in a row that determine all directions with x known
  int scans_ = 0;  // of the stretch so far
  std::int64_t settled_keyframe_ = 0;
  std::int64_t first_keyframe_ = 0;  // that may have entered the map in it
  // The last frame.
  bool any_ = false;
  StampNs stamp_ns_ = 0;
  SE3 T_world_lidar_;
  Matrix12d covariance_ = Matrix12d::Zero();
};

}  // namespace lamina
