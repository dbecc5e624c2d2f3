// What the page of `lamina doctor` shows, in its form: tools/web/doctor.js reads it.
#pragma once

#include <nlohmann/json.hpp>

#include "tools/doctor/findings.h"

namespace lamina {

// Positions are float32 x, y in base64, in the frame of the place's piece; those of a trajectory
// and of the map around a place are thinned to some thousand. A map that cannot be read is left out
// and noted.
nlohmann::json DoctorData(const DoctorFindings& findings);

}  // namespace lamina
