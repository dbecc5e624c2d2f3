// The board's report as text for programs.
#pragma once

#include <cstdint>
#include <string>

#include "tools/watch/live/view.h"

namespace lamina {

// One JSON object; keys carry units. What does not exist yet is null.
std::string StatusJson(const LiveReport& report);

// {"first": N, "lag_ms": [...], "read_ms": [...], ...}, a value for each frame from N on.
std::string TimingsJson(const TimingPage& page);

// Text format of Prometheus, version 0.0.4: names lamina_*, base units, counters end in _total.
std::string PrometheusText(const LiveReport& report);

}  // namespace lamina
