// What is known of a weak place of a run beside its own symptom.
//
// Private to tools/doctor.
#pragma once

#include "tools/doctor/weak_places.h"
#include "tools/results/run_table.h"

namespace lamina {

// kUnknown where nothing is.
struct PlaceFigures {
  double interval_s = kUnknown;  // before its first scan
  double usual_interval_s = kUnknown;
  double speed_m_s = kUnknown;                    // just before it ...
  double step_m = kUnknown, step_deg = kUnknown;  // ... and from scan to scan
  double points = kUnknown, points_before = kUnknown;
  double overlap = kUnknown, fit = kUnknown;  // medians
};

PlaceFigures FiguresOf(const RunTable& table, const WeakPlaces& places, const WeakPlace& place);

}  // namespace lamina
