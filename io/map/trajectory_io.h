// Trajectories on disk.
//
//   KITTI  12 numbers a line, row-major 3x4 [R | t], no stamps.
//   TUM    `stamp_s tx ty tz qx qy qz qw` a line.
//
// Both are written with T_world_lidar, with the digits that read back the very same numbers (a
// pose to better than 1e-9; TUM stamps have 9 decimals and are exact to the ns). In both, a line
// that starts with # is a comment, and blank lines and CRLF are tolerated.
//
// Read as well: pose_scanner_leica.csv of the ETHZ data set (any file that ends in .csv), a header
// and then T00 ... T33 and perhaps a timestamp a line.
#pragma once

#include <string>
#include <vector>

#include "core/geometry/scan.h"

namespace lamina {

// Reads either form, told apart by the count of numbers on the first line. KITTI pose i (from 0)
// gets the stamp `stamps_ns[i]` if those are given (at least as many as poses), otherwise i. Throws
// InputError with file and line for a wrong count of numbers, NaN, a rotation that is not
// orthonormal within 1e-3 (smaller errors, from rounding in text, are repaired); and for a file
// without any pose.
Trajectory ReadTrajectory(const std::string& path, const std::vector<StampNs>& stamps_ns = {});

// Poses of the camera to poses of the LiDAR, as KITTI odometry's poses/NN.txt need:
// T_world_lidar(i) = T_camera_lidar^-1 * T_world_camera(i) * T_camera_lidar.
Trajectory CameraToLidar(const Trajectory& cameras, const SE3& T_camera_lidar);

enum class TrajectoryForm { kKitti, kTum };

// Appends a stamp to a text as decimal seconds that are exact to the ns: -1.500000000.
// ParseSecondsNs (io/file/text_input.h) reads it back.
void AppendSeconds(StampNs stamp_ns, std::string* text);

// Appends the line of a pose to a text.
void AppendPoseLine(const StampedPose& pose, TrajectoryForm form, std::string* text);

// A whole file of such lines. Throw OutputError.
void WriteKittiTrajectory(const std::string& path, const Trajectory& trajectory);
void WriteTumTrajectory(const std::string& path, const Trajectory& trajectory);

}  // namespace lamina
