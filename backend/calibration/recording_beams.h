// The beams of the sensor behind a recording, each for itself: poses by mapping, then
// beam_calibration.h.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "backend/calibration/sensor_calibration.h"
#include "backend/mapping/mapped_scan.h"
#include "backend/mapping/options.h"
#include "core/geometry/scan_source.h"
#include "frontend/scan/beam_table.h"

namespace lamina {

struct CalibrationDrive;

struct RecordingBeams {
  bool on_cones = false;          // whether the sensor's points tell their beams
  std::vector<BeamOffset> beams;  // empty: not found, or planes are not thinner: `why` tells
  std::string why;
  // Roots of the mean squared distances of points to their planes, without these offsets and with.
  double thickness_before_m = 0.0, thickness_m = 0.0;
};

// From scans [begin, end), which must be of one sensor, its frame being that of the poses. What
// `mapping` configures of beams is looked past. on_scan is called for each scan that is mapped,
// unless null. Deterministic at any number of threads.
RecordingBeams CalibrateRecordingBeams(const ScanSource& source, std::size_t begin, std::size_t end,
                                       const MappingOptions& mapping,
                                       const CalibrationOptions& options,
                                       const std::function<void(const MappedScan&)>& on_scan,
                                       const std::atomic<bool>* stop = nullptr);
// The same of scans that were mapped before.
RecordingBeams CalibrateDriveBeams(const ScanSource& source, std::size_t begin, std::size_t end,
                                   const CalibrationDrive& drive, const MappingOptions& mapping,
                                   const CalibrationOptions& options,
                                   const std::atomic<bool>* stop = nullptr);

}  // namespace lamina
