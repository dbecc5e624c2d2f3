// NumPy arrays in and out: points, poses, trajectories.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/scan.h"

namespace lamina::python {

// Arrays of other types are converted, which copies them.
using Points = pybind11::array_t<float, pybind11::array::c_style | pybind11::array::forcecast>;
using Times = pybind11::array_t<float, pybind11::array::c_style | pybind11::array::forcecast>;
using Poses = pybind11::array_t<double, pybind11::array::c_style | pybind11::array::forcecast>;

// Points (N, 3) or (N, 4) with intensity, LiDAR frame, metres; times (N,), seconds from the stamp.
// Throw InputError for other shapes.
Scan ScanFromArrays(const Points& points, std::int64_t stamp_ns,
                    const std::optional<Times>& times_s);
// (N, 4): x, y, z, intensity.
pybind11::array_t<float> PointsOf(const Scan& scan);
// (N,); None if the points have no times.
pybind11::object TimesOf(const Scan& scan);

// (4, 4), row-major.
pybind11::array_t<double> PoseArray(const SE3& T);
// From (N, 4, 4); stamps are the numbers 0 to N - 1 in seconds. Throws InputError for another
// shape, or a matrix that is no pose.
Trajectory TrajectoryFromPoses(const Poses& poses, const std::string& name);

// Poses of scans in order, as arrays.
struct PoseList {
  std::vector<std::int64_t> stamps_ns, pieces;
  std::vector<bool> skipped;
  std::vector<SE3> poses;

  void Add(const StampedPose& pose, bool was_skipped, std::int64_t piece);
  pybind11::array_t<std::int64_t> StampArray() const;
  pybind11::array_t<std::int64_t> PieceArray() const;
  pybind11::array_t<bool> SkippedArray() const;
  pybind11::array_t<double> Array() const;  // (N, 4, 4)
};

}  // namespace lamina::python
