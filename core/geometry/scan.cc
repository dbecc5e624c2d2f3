#include "core/geometry/scan.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/median.h"

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

TimeSpan UsualSpanOfTimes(std::vector<float> times_s) {
  times_s.erase(
      std::remove_if(times_s.begin(), times_s.end(), [](float t) { return !std::isfinite(t); }),
      times_s.end());
  if (times_s.empty()) return {};
  constexpr double kOutliers = 0.01;
  const auto low_s = static_cast<double>(Quantile(&times_s, kOutliers));
  return {low_s, static_cast<double>(Quantile(&times_s, 1.0 - kOutliers))};
}

}  // namespace lamina
