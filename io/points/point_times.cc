#include "io/points/point_times.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "core/base/error.h"
#include "core/base/median.h"
#include "core/base/thinning.h"

namespace lamina {
namespace {

using TimeUnit = PointTimeUnit;

// What is decided of a field is decided in numbers that hold every int64, uint64 and double without
// loss (80 bits on x86, 128 on ARM): nanoseconds since an epoch do not fit a double.
using RawTime = long double;
static_assert(std::numeric_limits<RawTime>::digits >= 64, "stamps in ns need 64 bits");

constexpr std::array<RawTime, 4> kNsPerUnit = {1e9L, 1e6L, 1e3L, 1.0L};  // from kSeconds on
constexpr RawTime kNsPerS = 1e9L;
constexpr RawTime kOffsetLimitNs = 1.0L * kNsPerS;

// Of the finite values; low > high if there is none.
struct Range {
  RawTime low = std::numeric_limits<RawTime>::infinity();
  RawTime high = -std::numeric_limits<RawTime>::infinity();
};

template <typename T>
bool IsFinite([[maybe_unused]] T value) {
  if constexpr (std::is_floating_point_v<T>) return std::isfinite(value);
  return true;
}

// The nearest value of type T.
template <typename T>
T ClampedTo(RawTime value) {
  const auto low = static_cast<RawTime>(std::numeric_limits<T>::lowest());
  const auto high = static_cast<RawTime>(std::numeric_limits<T>::max());
  return value <= low    ? std::numeric_limits<T>::lowest()
         : value >= high ? std::numeric_limits<T>::max()
                         : static_cast<T>(value);
}

// The range of nearly all values: between the 1 % and 99 % quantiles of some of them. A few damaged
// ones are none of the times of a scan.
template <typename T>
Range UsualRange(const std::vector<T>& values) {
  constexpr std::size_t kEnough = 1024;
  constexpr double kOutliers = 0.01;
  const std::size_t stride = StrideToAtLeast(values.size(), kEnough);
  std::vector<T> some;
  some.reserve(values.size() / stride + 1);
  for (std::size_t i = 0; i < values.size(); i += stride) {
    if (IsFinite(values[i])) some.push_back(values[i]);
  }
  if (some.empty()) return {};
  const auto low = static_cast<RawTime>(Quantile(&some, kOutliers));
  return {low, static_cast<RawTime>(Quantile(&some, 1.0 - kOutliers))};
}

// Of the finite values within `among`.
template <typename T>
Range RangeAmong(const std::vector<T>& values, const Range& among) {
  // Several beside each other: the next comparison need not wait for the last one.
  constexpr std::size_t kLanes = 8;
  const T from = ClampedTo<T>(among.low), to = ClampedTo<T>(among.high);
  std::array<T, kLanes> low, high;
  low.fill(std::numeric_limits<T>::max());
  high.fill(std::numeric_limits<T>::lowest());
  const auto take = [&](std::size_t lane, T v) {
    // False of what is not finite, too.
    const bool within = (v >= from) & (v <= to);
    low[lane] = within & (v < low[lane]) ? v : low[lane];
    high[lane] = within & (v > high[lane]) ? v : high[lane];
  };
  const std::size_t whole = values.size() - values.size() % kLanes;
  for (std::size_t i = 0; i < whole; i += kLanes) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) take(lane, values[i + lane]);
  }
  for (std::size_t i = whole; i < values.size(); ++i) take(i - whole, values[i]);
  const T least = *std::min_element(low.begin(), low.end());
  const T most = *std::max_element(high.begin(), high.end());
  if (least > most) return {};
  return {static_cast<RawTime>(least), static_cast<RawTime>(most)};
}

bool SinceUnixEpoch(RawTime ns) { return ns > 1e9L * kNsPerS && ns < 3e9L * kNsPerS; }

RawTime DetectNsPerUnit(const Range& range, const std::string& field) {
  const RawTime span = range.high - range.low;
  RawTime best = 0.0L, best_score = std::numeric_limits<RawTime>::infinity();
  for (const RawTime ns_per_unit : kNsPerUnit) {
    const RawTime span_s = span * ns_per_unit / kNsPerS;
    // A field of one value has no span: its clock alone can tell the unit.
    const bool epoch = SinceUnixEpoch(range.low * ns_per_unit);
    if (span > 0.0L ? span_s < 1e-3L || span_s > 10.0L : !epoch) continue;
    const RawTime score = epoch ? -1.0L : std::abs(std::log10(span_s / 0.1L));
    if (score < best_score) best = ns_per_unit, best_score = score;
  }
  if (best == 0.0L && span > 0.0L) {
    throw InputError(
        fmt::format("{}: spans {} to {}, which is no scan of 1 ms to 10 s in s, ms, us or ns; set "
                    "point_time_unit",
                    field, static_cast<double>(range.low), static_cast<double>(range.high)));
  }
  return best;
}

// Seconds from `origin`, a value of the field, plus `rest_s`. The difference of two values is
// exact, or as exact as they are themselves. NaN of those beyond the range.
template <typename T>
std::vector<float> Seconds(const std::vector<T>& raw, const Range& range, T origin, double rest_s,
                           double per_s) {
  constexpr float kDamaged = std::numeric_limits<float>::quiet_NaN();
  const T low = ClampedTo<T>(range.low), high = ClampedTo<T>(range.high);
  std::vector<float> time_s(raw.size());
  for (std::size_t i = 0; i < raw.size(); ++i) {
    // The difference of others may not fit.
    const bool within = (raw[i] >= low) & (raw[i] <= high);
    const double s = static_cast<double>((within ? raw[i] : origin) - origin) / per_s + rest_s;
    time_s[i] = within ? static_cast<float>(s) : kDamaged;
  }
  return time_s;
}

// What lies this far beyond the usual times is damaged.
RawTime Slack(const Range& usual, RawTime ns_per_unit) {
  constexpr RawTime kSlackS = 0.25L;
  const RawTime span = usual.high - usual.low;
  return span > 0.0L ? std::max(span, kSlackS * kNsPerS / ns_per_unit) : 0.0L;
}

}  // namespace

template <typename T>
PointTimes ConvertPointTimes(const std::vector<T>& raw, TimeUnit unit, const std::string& field) {
  PointTimes times;
  const Range usual = UsualRange(raw);
  if (!(usual.low <= usual.high)) return times;  // no finite value
  const RawTime magnitude = std::max(std::abs(usual.low), std::abs(usual.high));
  const bool coarse = std::is_same_v<T, float>;
  if (coarse &&
      usual.high - usual.low < 16.0L * magnitude * std::numeric_limits<float>::epsilon()) {
    return times;
  }

  const RawTime ns_per_unit = unit == TimeUnit::kAuto
                                  ? DetectNsPerUnit(usual, field)
                                  : kNsPerUnit[static_cast<std::size_t>(unit) - 1];
  const RawTime slack = Slack(usual, ns_per_unit);
  const Range range = RangeAmong(raw, {usual.low - slack, usual.high + slack});
  if (magnitude * ns_per_unit > static_cast<RawTime>(std::numeric_limits<StampNs>::max() / 2)) {
    throw InputError(fmt::format("{}: time {} does not fit 64 bits of ns", field,
                                 static_cast<double>(magnitude)));
  }
  const bool clock =
      range.low * ns_per_unit > kOffsetLimitNs || range.high * ns_per_unit < -kOffsetLimitNs;
  if (clock) times.stamp_ns = static_cast<StampNs>(std::llround(range.low * ns_per_unit));
  constexpr std::array<const char*, 4> kUnits = {"s", "ms", "us", "ns"};
  const auto place = std::find(kNsPerUnit.begin(), kNsPerUnit.end(), ns_per_unit);
  if (place != kNsPerUnit.end()) {
    times.unit = kUnits[static_cast<std::size_t>(place - kNsPerUnit.begin())];
  }
  if (range.low == range.high) return times;
  const auto per_s = static_cast<double>(kNsPerS / ns_per_unit);
  if (!clock) {
    times.time_s = Seconds(raw, range, T{0}, 0.0, per_s);
    return times;
  }
  // Both are near to each other: in seconds an epoch does not fit a double to the nanosecond.
  const RawTime rest_ns = range.low * ns_per_unit - static_cast<RawTime>(times.stamp_ns);
  times.time_s =
      Seconds(raw, range, static_cast<T>(range.low), static_cast<double>(rest_ns / kNsPerS), per_s);
  return times;
}

template PointTimes ConvertPointTimes(const std::vector<float>&, TimeUnit, const std::string&);
template PointTimes ConvertPointTimes(const std::vector<double>&, TimeUnit, const std::string&);
template PointTimes ConvertPointTimes(const std::vector<std::uint32_t>&, TimeUnit,
                                      const std::string&);
template PointTimes ConvertPointTimes(const std::vector<std::int64_t>&, TimeUnit,
                                      const std::string&);
template PointTimes ConvertPointTimes(const std::vector<std::uint64_t>&, TimeUnit,
                                      const std::string&);

}  // namespace lamina
