#include "tools/run/beam_correction.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <string>
#include <vector>

#include "core/base/angle.h"

namespace lamina {

using Outcome = OpeningCalibration::Outcome;

namespace {

struct Extent {
  double low = 0.0, high = 0.0;
};

Extent ExtentOf(const std::vector<BeamOffset>& beams, double BeamOffset::*what) {
  Extent extent{beams.front().*what, beams.front().*what};
  for (const BeamOffset& beam : beams) {
    extent.low = std::min(extent.low, beam.*what);
    extent.high = std::max(extent.high, beam.*what);
  }
  return extent;
}

// What the first scans tell, as options.
std::string Told(const OpeningCalibration& opening) {
  if (opening.beams.empty()) {
    return fmt::format("preparation.vertical_correction_deg={:.3f} (sigma {:.3f})",
                       Degrees(opening.elevation_rad), Degrees(opening.sigma_rad));
  }
  const Extent turned = ExtentOf(opening.beams, &BeamOffset::elevation_correction_deg);
  const Extent longer = ExtentOf(opening.beams, &BeamOffset::range_correction_m);
  return fmt::format(
      "preparation.beams ({} beams, elevations by {:.2f} to {:.2f} deg, ranges by {:.3f} to {:.3f} "
      "m)",
      opening.beams.size(), turned.low, turned.high, longer.low, longer.high);
}

}  // namespace

void LogBeamCorrection(const OpeningCalibration& opening) {
  if (opening.outcome == Outcome::kNotLookedFor) return;
  if (opening.outcome == Outcome::kRefused) {
    spdlog::info(
        "the first {} scans leave planes {:.1f} mm thick; should the sensor's beams be off, they "
        "are not corrected: {}",
        opening.scans, 1e3 * opening.before.median_m, opening.why);
    return;
  }
  spdlog::warn(
      "the sensor's beams are off, and all scans are corrected: the first {} tell {} and have "
      "planes {:.1f} mm thick with it, {:.1f} mm without. config.yaml has it, for other recordings "
      "of this sensor; `lamina calibrate` finds it from a whole recording; "
      "preparation.beam_correction=off leaves the beams as they are",
      opening.scans, Told(opening), 1e3 * opening.after.median_m, 1e3 * opening.before.median_m);
}

nlohmann::json ToJson(const OpeningCalibration& opening) {
  nlohmann::json json = {{"applied", opening.outcome == Outcome::kCorrected},
                         {"scans", opening.scans},
                         {"median_thickness_uncorrected_m", opening.before.median_m}};
  if (opening.beams.empty()) {
    json["vertical_correction_deg"] = Degrees(opening.elevation_rad);
    json["vertical_correction_sigma_deg"] = Degrees(opening.sigma_rad);
  }
  for (const BeamOffset& beam : opening.beams) {
    json["beams"].push_back({{"elevation_deg", beam.elevation_deg},
                             {"elevation_correction_deg", beam.elevation_correction_deg},
                             {"range_correction_m", beam.range_correction_m}});
  }
  if (opening.after.planes > 0) json["median_thickness_m"] = opening.after.median_m;
  if (!opening.why.empty()) json["refused"] = opening.why;
  return json;
}

}  // namespace lamina
