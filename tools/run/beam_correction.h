// What a run says of beams of the sensor that are off
// (backend/calibration/opening_calibration.h).
#pragma once

#include <nlohmann/json.hpp>

#include "backend/calibration/opening_calibration.h"

namespace lamina {

// What was found and applied, with the options that make it permanent or turn it off, as a warning;
// or why nothing is. Nothing if nothing was looked for.
void LogBeamCorrection(const OpeningCalibration& opening);

// For summary.json.
nlohmann::json ToJson(const OpeningCalibration& opening);

}  // namespace lamina
