// From raw returns to usable points: finiteness and range filter, correction of the vertical angle
// and of the range (sensor_intrinsics.h), and the time of every point.
//
// Points are NOT deskewed here. They stay in the LiDAR frame of their own instant, with that
// instant beside them; clusters of them are deskewed later, in closed form, under whatever motion
// is known best at that moment (TimedCluster in core/geometry/point_cluster.h).
#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

#include "core/geometry/scan.h"
#include "core/options/options.h"
#include "frontend/scan/beam_table.h"

namespace lamina {

struct ScanPreparationOptions {
  double min_range_m = 2.0;
  double max_range_m = 100.0;

  // Turns each point p by this angle about p x z. HDL-64E scans of KITTI want +0.205.
  double vertical_correction_deg = 0.0;
  // Added to each range, after the filter above.
  double range_offset_m = 0.0;
  // What each beam has wrong for itself (beam_table.h), by its elevation as reported; these come
  // before the two above.
  std::vector<BeamOffset> beams;
  // Whether a recording's first scans may tell these three, where none is set
  // (backend/calibration/opening_calibration.h); PrepareScan does not look at it.
  enum class BeamCorrection { kOff, kAuto };
  BeamCorrection beam_correction = BeamCorrection::kAuto;

  enum class Deskew {
    kOff,      // scans were deskewed before, or the sensor stood still
    kTime,     // per-point time of the file; a scan without it is taken as instantaneous
    kAzimuth,  // a spinning sensor without per-point time: time from the azimuth of the point
    kAuto,     // per-point time where the file has it, otherwise off; first scans may tell more
               // (backend/opening/deskew_choice.h, sweep_choice.h)
  };
  Deskew deskew = Deskew::kAuto;

  // kAzimuth: sense of rotation seen from above, and the azimuth (deg, atan2(y, x)) at which the
  // sweep is cut, that is, where it starts and ends.
  enum class Rotation { kClockwise, kCounterclockwise };
  Rotation rotation = Rotation::kClockwise;
  double sweep_start_azimuth_deg = 180.0;
  // kAzimuth: the instant of the stamp, as a fraction of the sweep: 0 start, 0.5 middle, 1 end.
  double stamp_at_sweep_fraction = 0.5;
  // kAzimuth: duration of a sweep; 0: taken from the recording's stamps.
  double sweep_period_s = 0.0;

  void Visit(OptionVisitor& v);
  // Throws OptionError, naming both, if two contradict one another.
  void CheckTogether() const;
};

// A point in the LiDAR frame of the instant `time_s` seconds after the scan's stamp.
struct TimedPoint {
  float x, y, z, time_s;
};

struct PreparedScan {
  std::vector<TimedPoint> points;
  std::size_t non_finite = 0;    // dropped: NaN or infinite
  std::size_t out_of_range = 0;  // dropped: nearer than min_range_m or farther than max_range_m
  std::size_t out_of_time = 0;   // dropped: of a time that is none of this scan (PossibleTimes)
};

// Pure function of its arguments; thread-safe. `sweep_period_s` is the time between scans by their
// stamps, used where the option of that name is 0. Points are returned in the frame of the vehicle,
// after all that is done in that of the sensor.
PreparedScan PrepareScan(const Scan& scan, const ScanPreparationOptions& options,
                         double sweep_period_s, const SE3& T_vehicle_lidar = SE3());

// The median time between scans, of the newest ones, however long; nothing if the stamps do not
// tell.
std::optional<double> TimeBetween(const std::vector<StampNs>& stamps,
                                  std::size_t most = std::numeric_limits<std::size_t>::max());

// The period that PrepareScan wants for scan i: the median of the last (up to 9) positive
// differences of the stamps up to i, or `fallback_s` where there is none, or where it is longer
// than any sensor's sweep, 0.22 s: the scans are some of many. A dropped scan does not change it.
double SweepPeriod(const std::vector<StampNs>& stamps_up_to_i, double fallback_s);

}  // namespace lamina
