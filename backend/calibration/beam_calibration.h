// What each beam of a sensor has wrong for itself: the elevations and ranges that make the map
// thinnest.
//
// A drive gives segments, as in sensor_calibration.h; each keeps the points of its frames. A round
//
//     corrects the points by the present offsets, and makes a map of each segment
//     eliminates planes and poses (beam_system.h)
//     steps by -(sum H_s + prior)^-1 (sum g_s + prior), the poses following
//
// The prior is what sensors are off by: 0.5 degrees and 5 cm in common, 0.2 degrees and 3 cm each
// beam besides. It decides what planes do not: a beam that sees none stays as it is, and so do the
// world's heights, since beams of a sensor that does not lean can stretch them and leave all walls
// and floors flat. It ends early where planes are not clearly thinner after two rounds.
//
// Private to backend/calibration.
#pragma once

#include <atomic>
#include <cstddef>
#include <vector>

#include "backend/calibration/calibration_drive.h"
#include "core/map/voxel_map.h"
#include "frontend/scan/beam_table.h"
#include "frontend/scan/scan_preparation.h"

namespace lamina {

struct BeamCalibrationFrame {
  SE3 T_world_lidar;
  SweepMotion sweep;
  std::vector<TimedPoint> points;  // as the driver reports them
};
using BeamCalibrationSegment = std::vector<BeamCalibrationFrame>;

struct BeamCalibrationResult {
  std::vector<BeamOffset> beams;
  // Roots of the mean squared distances of points to their planes, in the first round and the last.
  double thickness_before_m = 0.0, thickness_m = 0.0;

  // Clearly: by a tenth. Beams of a sensor that is known well leave planes as thick as they were,
  // or thicker; those that are off by 0.1 degrees make them twice as thick as they need be.
  bool Thinner() const { return thickness_m < 0.9 * thickness_before_m; }
};

// Deterministic at any number of threads. Poses of the segments are moved along.
BeamCalibrationResult CalibrateBeams(const std::vector<double>& elevations_rad,
                                     const VoxelMapOptions& map,
                                     std::vector<BeamCalibrationSegment>* segments,
                                     const std::atomic<bool>* stop = nullptr);

}  // namespace lamina
