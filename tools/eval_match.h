// Which pose of an estimate belongs to which of the truth.
#pragma once

#include <string>
#include <vector>

#include "core/scan.h"
#include "tools/map_quality.h"

namespace lamina {

// An estimate with the truth that belongs to it, pose by pose.
struct ComparedTrajectory {
  std::string name;
  Trajectory estimate;
  Trajectory truth;
};

// A true trajectory, KITTI or TUM form; `stamps` are for KITTI's. If `calib` (calib.txt of KITTI
// odometry) is not empty, its poses are of the camera and become those of the LiDAR. Throws
// InputError.
Trajectory ReadTruth(const std::string& path, const std::string& calib,
                     const std::vector<StampNs>& stamps);

// Poses read without stamps carry their line numbers instead.
bool HasStamps(const Trajectory& trajectory);

// By stamp within the tolerance, or by line number if neither has stamps. Throws InputError if just
// one has, or if fewer than 2 poses match.
ComparedTrajectory MatchToTruth(const NamedTrajectory& estimate, const Trajectory& truth,
                                double tolerance_s);

}  // namespace lamina
