// What of the sensor's beams is off, as the first scans of a recording tell by themselves.
//
// Ground seen by beams that are off by an angle is a shallow bowl that goes along with the sensor:
// each scan turns a little against the map, always the same way, and the poses bend upwards or
// downwards. A quarter of a degree makes 1 % of drift. Where the map of the first scans is not as
// thin as that of a sensor whose beams are known, these scans are calibrated, and mapping begins
// anew with what is found:
//
//     each beam by itself     beam_calibration.h, where points lie on cones, one a beam; believed
//                             if planes of the same scans are thinner by a tenth
//     all beams by an angle   recording_calibration.h, for the elevation offset alone, elsewhere;
//                             believed if |offset| > 3 sigma (intrinsics_estimate.h), and planes of
//                             the same scans are thinner by 1 %
//
// planes in the median and in the thinnest quarter (MapThickness), and if no more scans are lost.
// If mapping anew does not bear it out, mapping begins once more, as it was.
//
// No angle is believed of a sensor that sees less than half of a turn around its z axis (there may
// be no rings about it), or that leans by more than 10 degrees against its first pose (what a sweep
// bends shows as much as beams do); and nothing of one that is shaken (shaken_sweep.h), nor what no
// option may be set to. A plain field determines nothing. Nothing is looked for where scans are of
// several sensors, or of one that a pose on its vehicle is configured for.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "backend/calibration/sensor_calibration.h"
#include "backend/mapping/mapping.h"
#include "backend/mapping/options.h"
#include "backend/opening/map_thickness.h"
#include "core/geometry/scan_source.h"
#include "frontend/scan/beam_table.h"

namespace lamina {

struct OpeningCalibration {
  enum class Outcome {
    kNotLookedFor,  // switched off, or configured, or planes are thin
    kRefused,       // `why` tells
    kCorrected,
  };
  Outcome outcome = Outcome::kNotLookedFor;
  std::string why;
  std::size_t scans = 0;  // that were looked at
  // What was found of each beam; or of all alike, and how well it is known, 0 where it is not
  // determined.
  std::vector<BeamOffset> beams;
  double elevation_rad = 0.0, sigma_rad = 0.0;
  MapThickness before, after;  // of the map of these scans; `after` where it was mapped anew
};

// Makes a mapping with these options in the place of the one it made before, if any, and forgets
// all that has come of that. The mapping must live until the next call.
using BeginMapping = std::function<Mapping*(const MappingOptions&)>;

struct MappedRecording {
  Mapping* mapping = nullptr;  // the last that was begun, not finished
  std::size_t processed = 0;   // scans of it
  OpeningCalibration opening;
};

// MapScans (backend/mapping/pipeline.h) of scans [begin, end), beams corrected, unless
// preparation.beam_correction is off or offsets are configured. It takes effect for all scans, the
// first included. Once `stop` is true, what was mapped until then stays. Deterministic at any
// number of threads; where nothing is corrected, the result is that of MapScans.
MappedRecording MapWithBeamCorrection(const ScanSource& source, std::size_t begin, std::size_t end,
                                      const MappingOptions& options,
                                      const CalibrationOptions& calibration,
                                      const BeginMapping& begin_mapping,
                                      const std::atomic<bool>* stop = nullptr);

}  // namespace lamina
