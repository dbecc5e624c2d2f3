// The sensor's elevation and range offset (frontend/scan/sensor_intrinsics.h) that make the map
// thinnest.
//
// A drive gives segments: some frames each, in order, at the poses that mapping found. Each segment
// is a bundle problem of its own (its own voxel map, no priors), and all share the two offsets. A
// round
//
//     moves the clusters by the present offsets, in closed form
//     casts and weighs each segment anew, and adjusts its poses
//     eliminates planes and poses (intrinsics_cost.h)
//     steps by -(sum H_s)^-1 sum g_s over the segments, the poses following
//
// until the step is small. Standard deviations are those of intrinsics_estimate.h.
//
// An offset whose standard deviation is beyond its limit is *not determined*: it stays at zero, and
// the other one is found alone. Flat ground and nothing else, one ring, a sensor that does not
// move.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "backend/bundle/solver/adjuster.h"
#include "backend/window/sliding_window.h"
#include "core/geometry/scan.h"
#include "core/map/voxel_map.h"
#include "core/options/options.h"
#include "frontend/scan/sensor_intrinsics.h"

namespace lamina {

struct CalibrationOptions {
  // Segments of a recording at most, evenly spread; and frames of each.
  int segments = 12;
  int segment_frames = 25;
  // Frames of a segment are at least this share of the median range apart, or turned by that angle
  // in radians: nearer ones repeat one another.
  double frame_spacing_share = 0.05;
  int max_rounds = 30;
  // Times that the recording is mapped, at most (recording_calibration.h).
  int max_passes = 4;
  // Takes the place of map.noise_floor_m: the flattest planes are to decide, for what
  // thickens the others is seen differently from each place.
  double noise_floor_m = 0.005;
  // Standard deviations beyond which an offset is not determined.
  double max_elevation_sigma_deg = 0.1;
  double max_range_sigma_m = 0.02;
  BundleAdjusterOptions solver = {20, 1e-6, 20};

  void Visit(OptionVisitor& v);
};

struct CalibrationFrame {
  StampNs stamp_ns = 0;
  SE3 T_world_lidar;
  SweepMotion sweep;
  std::vector<TimedCluster> measured;
};
using CalibrationSegment = std::vector<CalibrationFrame>;

struct CalibrationRound {
  int round = 0;  // from 0
  Intrinsics offsets = Intrinsics::Zero(), step = Intrinsics::Zero();
  std::size_t planes = 0;
  double thickness_m = 0.0;  // root of the mean squared distance of points to their planes
};

struct CalibrationResult {
  enum class Status {
    kConverged,
    kRoundLimit,     // usable with care: the last step was not small
    kNotDetermined,  // neither offset is
    kInterrupted,
  };
  Status status = Status::kNotDetermined;
  Intrinsics offsets = Intrinsics::Zero();
  // Where an offset is not determined, infinite if nothing at all is known of it.
  Intrinsics sigma = Intrinsics::Zero();
  std::array<bool, 2> determined = {false, false};
  std::size_t segments = 0;  // that took part
  std::vector<CalibrationRound> rounds;
};

// Numbers of the frames of each segment, from the poses of all frames, `usable` telling which may
// take part, and the median range of their points.
std::vector<std::vector<std::size_t>> PickSegments(const Trajectory& poses,
                                                   const std::vector<bool>& usable,
                                                   double median_range_m,
                                                   const CalibrationOptions& options);

class SensorCalibration {
 public:
  // Throws OptionError.
  SensorCalibration(const CalibrationOptions& options, const VoxelMapOptions& map,
                    const SlidingWindowOptions& weights);

  // Deterministic at any number of threads. Poses of the segments are moved along.
  CalibrationResult Run(std::vector<CalibrationSegment>* segments,
                        const std::function<void(const CalibrationRound&)>& on_round = nullptr,
                        const std::atomic<bool>* stop = nullptr) const;

 private:
  CalibrationOptions options_;
  VoxelMapOptions map_;
  SlidingWindowOptions weights_;
};

}  // namespace lamina
