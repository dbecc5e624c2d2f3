// What odometry finds of one scan: its pose, how far that is to be believed, and why.
#pragma once

#include "core/geometry/scan.h"
#include "core/geometry/se3.h"
#include "core/geometry/sweep_motion.h"
#include "frontend/matching/scan_matcher.h"
#include "frontend/odometry/sweep_acceleration.h"

namespace lamina {

struct OdometryFrame {
  enum class Status {
    kFirst,  // nothing to match against yet: the pose is the start
    kTracked,
    kLost,  // no match to be trusted: the pose is the prediction, and must not enter a map
  };
  Status status = Status::kFirst;
  StampNs stamp_ns = 0;
  SE3 T_world_lidar;
  SE3 T_world_predicted;
  SweepMotion sweep;               // during the scan
  SweepAcceleration acceleration;  // of it, where it was estimated
  MatchResult match;
  bool searched = false;  // a search ran
  // Standard deviation along the direction that the match knows least, where few surfaces face it
  // and the motion before tells no more (direction_profile.h); 0 elsewhere.
  double open_m = 0.0;
  // How far the match has left its prediction along that direction, where this is more than both
  // explain; 0 elsewhere.
  double surprise_m = 0.0;
  // Where another place explains the scan about as well (PoseSearch::Elsewhere), or no scan has
  // been told from all others since one of which that is true: tangent from the pose to that place.
  // Zero where there is none.
  Vector6d elsewhere = Vector6d::Zero();
};

}  // namespace lamina
