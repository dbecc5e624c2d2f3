#include "core/geometry/scan.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/median.h"
#include "core/base/thinning.h"

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

TimeSpan PossibleTimes(const std::vector<float>& times_s, double sweep_s) {
  // Of so many the quantiles are known well enough.
  constexpr std::size_t kEnough = 4000;
  std::vector<float> some;
  const std::size_t stride = StrideToAtLeast(times_s.size(), kEnough);
  for (std::size_t i = 0; i < times_s.size(); i += stride) some.push_back(times_s[i]);
  const TimeSpan usual = UsualSpanOfTimes(std::move(some));
  const double slack_s = std::max(sweep_s, 0.5 * usual.length_s());
  return {usual.low_s - slack_s, usual.high_s + slack_s};
}

}  // namespace lamina
