#include "tools/run/beam_correction.h"

#include <spdlog/spdlog.h>

#include "core/base/angle.h"

namespace lamina {

using Outcome = OpeningCalibration::Outcome;

void LogBeamCorrection(const OpeningCalibration& beams) {
  if (beams.outcome == Outcome::kNotLookedFor) return;
  if (beams.outcome == Outcome::kRefused) {
    spdlog::info(
        "the first {} scans leave planes {:.1f} mm thick; should the sensor's beams be off, they "
        "are not corrected: {}",
        beams.scans, 1e3 * beams.before.median_m, beams.why);
    return;
  }
  spdlog::warn(
      "the sensor's beams are off, and all scans are corrected: the first {} tell "
      "preparation.vertical_correction_deg={:.3f} (sigma {:.3f}) and have planes {:.1f} mm thick "
      "with it, {:.1f} mm without. config.yaml has it, for other recordings of this sensor; "
      "`lamina calibrate` finds it from a whole recording; preparation.beam_correction=off leaves "
      "the beams as they are",
      beams.scans, Degrees(beams.elevation_rad), Degrees(beams.sigma_rad),
      1e3 * beams.after.median_m, 1e3 * beams.before.median_m);
}

nlohmann::json ToJson(const OpeningCalibration& beams) {
  nlohmann::json json = {{"applied", beams.outcome == Outcome::kCorrected},
                         {"scans", beams.scans},
                         {"vertical_correction_deg", Degrees(beams.elevation_rad)},
                         {"vertical_correction_sigma_deg", Degrees(beams.sigma_rad)},
                         {"median_thickness_uncorrected_m", beams.before.median_m}};
  if (beams.after.planes > 0) json["median_thickness_m"] = beams.after.median_m;
  if (!beams.why.empty()) json["refused"] = beams.why;
  return json;
}

}  // namespace lamina
