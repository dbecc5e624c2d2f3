#include "tools/synth/engine/sensor_errors.h"

#include <cmath>

#include "core/base/angle.h"
#include "tools/synth/engine/random.h"

namespace lamina::synth {
namespace {

constexpr std::size_t kPackets = 75;  // a scan, as of a VLP-16 at 10 Hz

}  // namespace

void SensorErrorOptions::Visit(OptionVisitor& v) {
  v.Number("beam_elevation_offset_deg", &beam_elevation_offset_deg, -5.0, 5.0);
  v.Number("beam_elevation_sigma_deg", &beam_elevation_sigma_deg, 0.0, 5.0);
  v.Number("beam_range_sigma_m", &beam_range_sigma_m, 0.0, 1.0);
  v.Number("incidence_bias_m", &incidence_bias_m, -1.0, 1.0);
  v.Number("time_offset_s", &time_offset_s, -0.1, 0.1);
  v.Number("dropped_packets", &dropped_packets, 0.0, 0.99);
}

SensorErrors::SensorErrors(const SensorErrorOptions& options, std::size_t beams, std::int64_t seed)
    : options_(options), seed_(seed) {
  for (std::size_t b = 0; b < beams; ++b) {
    const auto beam = static_cast<std::int64_t>(b);
    const double elevation = GaussianFrom(HashOf({seed, 0xbea, beam}));
    const double range = GaussianFrom(HashOf({seed, 0xbeb, beam}));
    elevation_rad_.push_back(kDegree * (options.beam_elevation_offset_deg +
                                        options.beam_elevation_sigma_deg * elevation));
    range_m_.push_back(options.beam_range_sigma_m * range);
  }
}

Eigen::Vector3d SensorErrors::Fired(std::size_t beam, const Eigen::Vector3d& reported) const {
  if (elevation_rad_[beam] == 0.0) return reported;
  const double level = std::hypot(reported.x(), reported.y());
  const double elevation = std::atan2(reported.z(), level) + elevation_rad_[beam];
  const double scale = std::cos(elevation) / level;
  return {scale * reported.x(), scale * reported.y(), std::sin(elevation)};
}

bool SensorErrors::IsDropped(std::int64_t frame, std::size_t group, std::size_t groups) const {
  if (options_.dropped_packets == 0.0) return false;
  const auto packet = static_cast<std::int64_t>(group * kPackets / groups);
  return UniformFrom(HashOf({seed_, 0xd409, frame, packet})) < options_.dropped_packets;
}

}  // namespace lamina::synth
