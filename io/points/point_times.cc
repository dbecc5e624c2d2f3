#include "io/points/point_times.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "core/base/error.h"

namespace lamina {
namespace {

using TimeUnit = PointTimeUnit;

constexpr std::array<RawTime, 4> kNsPerUnit = {1e9L, 1e6L, 1e3L, 1.0L};  // from kSeconds on
constexpr RawTime kNsPerS = 1e9L;
constexpr RawTime kOffsetLimitNs = 60.0L * kNsPerS;

struct Range {
  RawTime low = std::numeric_limits<RawTime>::infinity();
  RawTime high = -std::numeric_limits<RawTime>::infinity();
};

Range FiniteRange(const std::vector<RawTime>& values) {
  Range range;
  for (const RawTime v : values) {
    if (!std::isfinite(v)) continue;
    range.low = std::min(range.low, v);
    range.high = std::max(range.high, v);
  }
  return range;
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

}  // namespace

PointTimes ConvertPointTimes(const std::vector<RawTime>& raw, bool is_float32, TimeUnit unit,
                             const std::string& field) {
  PointTimes times;
  const Range range = FiniteRange(raw);
  const RawTime span = range.high - range.low;
  if (!(range.low <= range.high)) return times;  // no finite value
  const RawTime magnitude = std::max(std::abs(range.low), std::abs(range.high));
  if (is_float32 && span < 16.0L * magnitude * std::numeric_limits<float>::epsilon()) return times;

  const RawTime ns_per_unit = unit == TimeUnit::kAuto
                                  ? DetectNsPerUnit(range, field)
                                  : kNsPerUnit[static_cast<std::size_t>(unit) - 1];
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
  if (span == 0.0L) return times;
  const RawTime origin_ns = static_cast<RawTime>(times.stamp_ns);
  times.time_s.reserve(raw.size());
  for (const RawTime v : raw) {
    const RawTime ns = std::isfinite(v) ? v * ns_per_unit - origin_ns : 0.0L;
    times.time_s.push_back(static_cast<float>(ns / kNsPerS));
  }
  return times;
}

}  // namespace lamina
