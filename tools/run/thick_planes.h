// What a run says of a map whose planes are thicker than the sensor's noise allows.
#pragma once

#include <string>

#include "backend/mapping/options.h"
#include "backend/opening/map_thickness.h"

namespace lamina {

// A line that names the options which would mend it; empty if planes are as thin as they should be,
// or too few to tell.
std::string ThickPlanesWarning(const MapThickness& map, const MappingOptions& options);

}  // namespace lamina
