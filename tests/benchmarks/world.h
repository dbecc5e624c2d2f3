// What the benchmarks work on: ground and walls as wide as a sensor on a car sees, and its sweeps.
#pragma once

#include <cmath>
#include <vector>

#include "tests/support/scenes/random_rooms.h"

namespace lamina {

inline World Neighbourhood(Draws* draws) {
  World world;
  for (int x = -2; x <= 2; ++x) {
    for (int y = -2; y <= 2; ++y) {
      world.facets.push_back({{20.0 * x, 20.0 * y, -1.7}, {10, 0, 0}, {0, 10, 0}});
    }
  }
  for (int i = 0; i < 60; ++i) {
    Eigen::Vector3d centre = draws->InCube(45.0);
    centre.z() = 0.8;
    const double angle = draws->Uniform(0.0, 3.14);
    world.facets.push_back(
        {centre, {5.0 * std::cos(angle), 5.0 * std::sin(angle), 0}, {0, 0, 2.5}});
  }
  return world;
}

// As many points as an HDL-64E returns, each at its time of the sweep about the stamp.
inline std::vector<TimedPoint> Sweep(const World& world, Draws* draws) {
  constexpr int kPointsOfAFacet = 1400;
  constexpr double kHalfSweepS = 0.05;
  std::vector<TimedPoint> points = StillPoints(world.Sample(kPointsOfAFacet, 0.01, draws));
  for (TimedPoint& p : points) {
    p.time_s = static_cast<float>(kHalfSweepS * std::atan2(p.y, p.x) / 3.14159265);
  }
  return points;
}

// Turning slowly at the speed of a car in town.
inline Vector6d CarTwist() {
  Vector6d twist;
  twist << 0.0, 0.0, 0.2, 10.0, 0.0, 0.0;
  return twist;
}

}  // namespace lamina
