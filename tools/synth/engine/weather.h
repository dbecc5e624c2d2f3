// Rain and spray: drops that return a ray before it has reached anything.
#pragma once

#include <cstdint>
#include <optional>

#include "core/options/options.h"
#include "tools/synth/engine/random.h"

namespace lamina::synth {

struct WeatherOptions {
  // Share of the rays that a drop within 15 m returns.
  double rain = 0.0;
  // Scans [first, first + scans) are nothing but spray, at 1 to 8 m.
  int spray_first = 0;
  int spray_scans = 0;

  bool IsSpray(std::int64_t frame) const {
    return frame >= spray_first && frame - spray_first < spray_scans;
  }
  void Visit(OptionVisitor& v) {
    v.Number("rain", &rain, 0.0, 1.0);
    v.Integer("spray_first", &spray_first, 0, 10000000);
    v.Integer("spray_scans", &spray_scans, 0, 10000000);
  }
};

// Range of the drop that the ray of this key may meet.
inline std::optional<double> DropRange(const WeatherOptions& o, std::int64_t frame,
                                       std::uint64_t ray_key) {
  if (o.IsSpray(frame)) {
    return 1.0 + 7.0 * UniformFrom(HashOf({static_cast<std::int64_t>(ray_key), 0x59}));
  }
  if (o.rain == 0.0) return std::nullopt;
  HashStream random(HashOf({static_cast<std::int64_t>(ray_key), 0x4a}));
  if (!random.Chance(o.rain)) return std::nullopt;
  return 0.5 + 14.5 * random.Uniform();
}

}  // namespace lamina::synth
