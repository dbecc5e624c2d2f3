// Which pose of an estimate belongs to which of the truth.
#pragma once

#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "tools/metrics/map_quality.h"
#include "tools/metrics/trajectory_metrics.h"

namespace lamina {

// An estimate with the truth that belongs to it, pose by pose.
struct ComparedTrajectory {
  std::string name;
  Trajectory estimate;
  Trajectory truth;
};

// Stamps that differ by no more belong together, unless the caller wants it otherwise.
constexpr double kStampToleranceS = 0.01;

// Poses of the camera as poses of the LiDAR, by the file `calib` (calib.txt of KITTI odometry); as
// they are if that is empty. Throws InputError.
Trajectory WithCalibration(const Trajectory& truth, const std::string& calib);

// Poses read without stamps carry their line numbers instead.
bool HasStamps(const Trajectory& trajectory);

// Throws InputError if just one has stamps, or if without stamps there are not as many of both.
void RequireMatchable(const NamedTrajectory& estimate, const Trajectory& truth);

// Matches a part of an estimate that RequireMatchable accepts: by stamp within the tolerance, or if
// the truth has no stamps by the line numbers that the poses carry. Throws InputError if fewer than
// 2 poses match. Logs when most poses of the part match none.
ComparedTrajectory MatchPart(const NamedTrajectory& part, const Trajectory& truth,
                             double tolerance_s);

// Both: for an estimate that is judged as a whole.
ComparedTrajectory MatchToTruth(const NamedTrajectory& estimate, const Trajectory& truth,
                                double tolerance_s);

// The errors of matched poses. Logs if the truth is of other axes (tools/metrics/truth_axes.h).
TrajectoryErrors ErrorsOf(const ComparedTrajectory& compared, Alignment alignment);

}  // namespace lamina
