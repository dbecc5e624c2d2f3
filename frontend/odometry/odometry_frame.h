// Result of odometry for one scan: its pose, how far that is to be believed, and why.
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
  // Standard deviation along the direction that the match knows least, if few surfaces face it and
  // the prediction tells no more (direction_profile.h); 0 otherwise.
  double open_m = 0.0;
  // Distance of the match from its prediction along that direction, if the uncertainties of both do
  // not explain it; 0 otherwise.
  double surprise_m = 0.0;
  // Tangent from the pose to another place, if that explains the scan about as well
  // (PoseSearch::Elsewhere), or explained an earlier one so and no scan since was told from all
  // others; zero otherwise.
  Vector6d elsewhere = Vector6d::Zero();
};

}  // namespace lamina
