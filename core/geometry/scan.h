// Scans as they come from a file, and trajectories as they go to one.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/geometry/se3.h"

namespace lamina {

// Time is a whole number of nanoseconds. Its origin is the recording's own (often the Unix epoch);
// only differences matter to the algorithms. Thread-safe as any plain number.
using StampNs = std::int64_t;

inline constexpr double kSecondsPerNs = 1e-9;
inline double SecondsBetween(StampNs from, StampNs to) {
  return static_cast<double>(to - from) * kSecondsPerNs;
}

// One return, LiDAR frame, metres. The memory layout is that of a KITTI .bin file.
struct ScanPoint {
  float x = 0.0F, y = 0.0F, z = 0.0F, intensity = 0.0F;
};
static_assert(sizeof(ScanPoint) == 16, "must match the layout of KITTI .bin files");

struct Scan {
  StampNs stamp_ns = 0;
  // The stamp is a number in a sequence times an assumed period, and says nothing of how much time,
  // or way, lies between two scans.
  bool stamp_made_up = false;
  std::vector<ScanPoint> points;
  // Seconds from stamp_ns to the measurement of each point (may be negative). Empty when the file
  // carries no time of its own; otherwise exactly as long as `points`.
  std::vector<float> time_s;
};

// From the earliest to the latest of times that are finite, s; both 0 if none is.
struct TimeSpan {
  double low_s = 0.0, high_s = 0.0;
  double length_s() const { return high_s - low_s; }
};
TimeSpan SpanOfTimes(const std::vector<float>& times_s);
// The same but for the hundredth at either end: single times may be damaged.
TimeSpan UsualSpanOfTimes(std::vector<float> times_s);
// From the earliest to the latest that may be of this scan, where sweeps take `sweep_s`: those
// farther from the usual ones are damaged, whatever they say.
TimeSpan PossibleTimes(const std::vector<float>& times_s, double sweep_s);

struct StampedPose {
  StampNs stamp_ns = 0;
  SE3 T_world_lidar;
};

using Trajectory = std::vector<StampedPose>;

}  // namespace lamina
