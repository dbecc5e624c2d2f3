// Where a weak place of a run is, and what was measured there, in words.
#pragma once

#include <string>

#include "tools/doctor/weak_places.h"

namespace lamina {

// "scan 5" or "scans 5 to 9".
std::string NameScans(const RunTable& table, const WeakPlace& place);

// Scans, time since the first scan of the run, way within the piece.
std::string DescribeWhere(const RunTable& table, const WeakPlace& place);

// The figure, and the rule that it breaks.
std::string DescribeFigure(const RunTable& table, const WeakPlaces& places, const WeakPlace& place);

}  // namespace lamina
