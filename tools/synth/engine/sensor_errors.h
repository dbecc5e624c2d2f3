// Errors of real sensors and their drivers: what is reported is not what the ray did.
//
// The true poses stay those of the ideal sensor. With b the beam (ring), c the cosine of the angle
// of incidence, e the elevation of the ray that the driver believes in:
//
//   elevation fired  e + offset + N(0, sigma_e^2)_b
//   range reported   r + N(0, sigma_r^2)_b + bias_i (1 - c) + noise
//   time reported    t + time_offset            (of a point, with `sweep`; the stamp is right)
//
// and a share of the packets never arrives, whole azimuths at once.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/options/options.h"

namespace lamina::synth {

struct SensorErrorOptions {
  double beam_elevation_offset_deg = 0.0;
  double beam_elevation_sigma_deg = 0.0;
  double beam_range_sigma_m = 0.0;
  double incidence_bias_m = 0.0;
  double time_offset_s = 0.0;
  double dropped_packets = 0.0;  // share, [0, 1)

  void Visit(OptionVisitor& v);
};

// Immutable: thread-safe.
class SensorErrors {
 public:
  SensorErrors(const SensorErrorOptions& options, std::size_t beams, std::int64_t seed);

  // Where the ray of a beam points that the driver takes for `reported`, both of unit length.
  Eigen::Vector3d Fired(std::size_t beam, const Eigen::Vector3d& reported) const;
  // What is added to the true range.
  double RangeBias(std::size_t beam, double cosine) const {
    return range_m_[beam] + options_.incidence_bias_m * (1.0 - cosine);
  }
  double time_offset_s() const { return options_.time_offset_s; }
  // Is the packet lost that a group of rays belongs to, one of `groups` of the scan?
  bool IsDropped(std::int64_t frame, std::size_t group, std::size_t groups) const;

 private:
  SensorErrorOptions options_;
  std::int64_t seed_;
  std::vector<double> elevation_rad_, range_m_;  // of each beam
};

}  // namespace lamina::synth
