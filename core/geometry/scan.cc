#include "core/geometry/scan.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lamina {

TimeSpan SpanOfTimes(const std::vector<float>& times_s) {
  float low = std::numeric_limits<float>::infinity(), high = -low;
  for (const float t : times_s) {
    if (!std::isfinite(t)) continue;
    low = std::min(low, t);
    high = std::max(high, t);
  }
  if (low > high) return {};
  return {static_cast<double>(low), static_cast<double>(high)};
}

}  // namespace lamina
