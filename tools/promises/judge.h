// Whether a trial has kept its promise.
//
// Only frames are judged whose pose the mapping vouches for: those that are neither lost nor
// degenerate. Each piece of the map has a frame of its own: the poses of its judged frames are
// fitted to the truth by one rigid motion, least squares over the positions and over points 1 m
// along the three axes of each sensor frame (so that a sensor that only turns has a fit, too).
// What remains is the error of a frame: the distance of its position, and the angle.
//
// Kept means: no judged frame is farther off than promised, or turned by more than kMostTurnDeg
// (where a drift is promised: no piece drifts more than that, and frames may be anywhere);
// no more frames are lost or degenerate than promised; and, where losing it is a failure, all
// judged frames belong to one piece.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "tools/promises/promises.h"

namespace lamina {

inline constexpr double kMostTurnDeg = 0.5;

struct TrialFrame {
  StampNs stamp_ns = 0;
  std::string status;      // as in frames.csv
  std::int64_t piece = 0;  // of the map; its poses have one frame
  SE3 T_world_lidar, T_world_lidar_true;
  // As the match reported them: the pose before any adjustment, and its covariance.
  SE3 T_world_matched;
  Matrix6d covariance = Matrix6d::Zero();
  double worst_sigma_m = 0.0;
};

struct Verdict {
  bool kept = false;
  std::string broken;                     // what was not kept, in words; empty if all was
  double worst_m = 0.0, worst_deg = 0.0;  // of the judged frames
  double drift_percent = 0.0;             // of the worst piece; 0 if none goes over 100 m
  std::size_t worst_frame = 0;            // the farthest off
  std::size_t judged = 0, lost = 0, degenerate = 0, pieces = 0;
  // Of each frame; NaN for frames that are not judged.
  std::vector<double> error_m, error_deg;
};

Verdict JudgeTrial(const std::vector<TrialFrame>& frames, const Promise& promise);

}  // namespace lamina
