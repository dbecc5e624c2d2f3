// Calibration of the sensor behind a recording: mapping for poses, then sensor_calibration.h, and
// again with the offsets found, until they change no more.
//
// The first poses are those of a sensor that is off by as much as it is: they drift, and planes of
// the map are thick, but over the metres of a segment they are good enough to begin with.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <vector>

#include "backend/calibration/sensor_calibration.h"
#include "backend/mapping/mapped_scan.h"
#include "backend/mapping/options.h"
#include "backend/opening/map_thickness.h"
#include "core/geometry/scan_source.h"

namespace lamina {

struct CalibrationPass {
  int pass = 0;  // from 0
  // What scans were mapped with: preparation.vertical_correction_deg (here in rad), range_offset_m.
  Intrinsics offsets = Intrinsics::Zero();
  std::size_t frames = 0, lost = 0;
  MapThickness map;
  CalibrationResult found;  // on top of `offsets`
};

struct RecordingCalibration {
  // Of the last pass. Where an offset is not determined, it is as configured.
  CalibrationResult result;
  // What to configure.
  Intrinsics offsets = Intrinsics::Zero();
  bool settled = false;  // a pass changed them by less than their standard deviation
  std::vector<CalibrationPass> passes;
};

// Scans [begin, end) of a source; where mapping makes pieces of them that nothing connects, the
// longest piece. on_scan is called for each scan that is mapped. Throws InputError
// if there are too few usable frames, OptionError. Deterministic at any number of threads.
RecordingCalibration CalibrateRecording(const ScanSource& source, std::size_t begin,
                                        std::size_t end, const MappingOptions& mapping,
                                        const CalibrationOptions& options,
                                        const std::function<void(const MappedScan&)>& on_scan,
                                        const std::function<void(const CalibrationPass&)>& on_pass,
                                        const std::atomic<bool>* stop = nullptr);

}  // namespace lamina
