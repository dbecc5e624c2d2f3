// A sensor whose beams are off, carried through a plain room: for tests of calibration.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/angle.h"
#include "frontend/scan/scan_preparation.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {

// Each range is measured too long by range_m, and each elevation too high by elevation_off_rad.
struct RoomBeam {
  double elevation_deg = 0.0, elevation_off_rad = 0.0, range_m = 0.0;
};

class RoomWalk {
 public:
  explicit RoomWalk(std::vector<RoomBeam> beams) : beams_(std::move(beams)) {}

  struct Stop {
    SE3 T_world_lidar;
    std::vector<TimedPoint> points;
  };
  std::vector<Stop> Walk(int stops, unsigned seed) const {
    Draws draws(seed);
    std::vector<Stop> walk;
    for (int i = 0; i < stops; ++i) {
      Stop stop;
      stop.T_world_lidar = SE3(ExpSO3({0, 0, draws.Uniform(-3.0, 3.0)}),
                               {draws.Uniform(-3.0, 3.0), draws.Uniform(-2.0, 2.0), 0.0});
      stop.points = Scan(stop.T_world_lidar, &draws);
      walk.push_back(std::move(stop));
    }
    return walk;
  }

 private:
  // Distance along a ray of the box |x| < 6.3, |y| < 4.3, -1.4 < z < 1.7.
  static double Range(const Eigen::Vector3d& p, const Eigen::Vector3d& d) {
    const Eigen::Vector3d low(-6.3, -4.3, -1.4), high(6.3, 4.3, 1.7);
    double nearest = 1e9;
    for (int i = 0; i < 3; ++i) {
      if (std::abs(d(i)) < 1e-12) continue;
      nearest = std::min(nearest, ((d(i) > 0.0 ? high(i) : low(i)) - p(i)) / d(i));
    }
    return nearest;
  }
  std::vector<TimedPoint> Scan(const SE3& T, Draws* draws) const {
    std::vector<TimedPoint> points;
    for (const RoomBeam& beam : beams_) {
      for (int a = 0; a < 720; ++a) {
        const double azimuth = a * kDegree / 2.0, e = beam.elevation_deg * kDegree;
        const auto ray = [&](double up) {
          return Eigen::Vector3d(std::cos(azimuth) * std::cos(up), std::sin(azimuth) * std::cos(up),
                                 std::sin(up));
        };
        const double range = Range(T.t, T.q * ray(e)) + beam.range_m + draws->Normal(0.01);
        const Eigen::Vector3f p = (range * ray(e + beam.elevation_off_rad)).cast<float>();
        points.push_back({p.x(), p.y(), p.z(), 0.0F});
      }
    }
    return points;
  }

  std::vector<RoomBeam> beams_;
};

// Beams that are all off alike, from 25 degrees below to 25 above.
inline std::vector<RoomBeam> RoomRings(int count, double elevation_off_rad, double range_m) {
  std::vector<RoomBeam> beams;
  for (int i = 0; i < count; ++i) {
    beams.push_back({-25.0 + 50.0 * i / (count - 1), elevation_off_rad, range_m});
  }
  return beams;
}

}  // namespace lamina
