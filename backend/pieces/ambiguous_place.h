// The place in which scans were found after a gap or a loss, while another one explains them as
// well (OdometryFrame::elsewhere).
//
// Scans that enter the map there make a place of it in which the next ones fit better than
// anywhere else, whether it is the right one or not. So the two are told apart by what was mapped
// before the gap alone (older_planes.h): with T_k the poses of the scans since then and D the
// motion of the world that takes the place where they were found to the other one, the poses D T_k
// are compared with T_k by the votes of blocks (plane_score.h), all scans together, z standard
// deviations, and by how unlikely the turn to each is, U' and U. The other place is refuted if
//
//     z |z| + U' - U > c^2.
//
// If it never is, nothing says where the scans are: they follow one another well, and begin a piece
// of their own.
#pragma once

#include <cstdint>
#include <vector>

#include "backend/window/sliding_window.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"
#include "frontend/odometry/motion_model.h"
#include "frontend/odometry/odometry_frame.h"

namespace lamina {

// Not thread-safe; deterministic.
class AmbiguousPlace {
 public:
  // A frame, before its scan enters the map and its pose the motion model; `next_keyframe` is the
  // number of the next keyframe.
  void Follow(const OdometryFrame& frame, const MotionModel& motion,
              const std::vector<TimedCluster>& clusters, const VoxelMap& map,
              const SlidingWindow& window, std::int64_t next_keyframe);

  // Whether the two places were not told apart by kMostScans scans, or the other one is better.
  bool over() const { return open_ && scans_ >= kMostScans; }
  // The first keyframe of these scans, if one of them became one.
  std::int64_t first_keyframe() const { return first_keyframe_; }
  void Forget() { open_ = false; }
  // Adds the other place to the covariance of the newest frame's match: degenerate along the way
  // there.
  void Widen(MatchResult* match) const;

  void Archive(StateArchive& a);

 private:
  // By how many standard deviations the place is better than the other one.
  double Sigmas(const OdometryFrame& frame, const std::vector<TimedCluster>& clusters,
                const VoxelMap& map, const SlidingWindow& window) const;

  // Scans that are compared; later ones are farther from what was mapped before.
  static constexpr int kMostScans = 5;

  bool open_ = false;
  bool before_ = false;  // the frame before was one of several places already
  int scans_ = 0;
  std::int64_t first_keyframe_ = 0;
  SE3 T_other_ours_;       // D
  double likelier_ = 0.0;  // U' - U
};

}  // namespace lamina
