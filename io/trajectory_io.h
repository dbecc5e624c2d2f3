// Trajectories on disk.
//
//   KITTI  12 numbers a line, row-major 3x4 [R | t], no stamps.
//   TUM    `stamp_s tx ty tz qx qy qz qw` a line, # starts a comment.
//
// Both are written with T_world_lidar, digits enough to read back the same pose to 1e-9 (TUM
// stamps: 9 decimals, exact ns).
#pragma once

#include <string>
#include <vector>

#include "core/scan.h"

namespace lamina {

// Reads either form, told apart by the numbers on the first line. KITTI poses get stamps
// `stamps_ns` if those are given, otherwise their line number. Throws InputError with file and line
// for a wrong count of numbers, NaN, a rotation that is not orthonormal within 1e-3 (smaller
// errors, from rounding in text, are repaired).
Trajectory ReadTrajectory(const std::string& path, const std::vector<StampNs>& stamps_ns = {});

// Poses of the camera to poses of the LiDAR, as KITTI odometry's poses/NN.txt need:
// T_world_lidar(i) = T_camera_lidar^-1 * T_world_camera(i) * T_camera_lidar.
Trajectory CameraToLidar(const Trajectory& cameras, const SE3& T_camera_lidar);

// Both write to a temporary name and rename. Throw OutputError.
void WriteKittiTrajectory(const std::string& path, const Trajectory& trajectory);
void WriteTumTrajectory(const std::string& path, const Trajectory& trajectory);

}  // namespace lamina
