// A sensor that is shaken while it takes its sweeps.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "frontend/scan/scan_clusters.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {

// A place as seen by a sensor that turns about z once in a sweep while it is shaken.
class ShakenSensor {
 public:
  static constexpr double kGapS = 0.1;

  // Turned to and fro by `amplitude_rad` about every axis, so often a second.
  ShakenSensor(double amplitude_rad, double hertz, double phase)
      : amplitude_(amplitude_rad), rate_(2.0 * M_PI * hertz), phase_(phase) {}

  SE3 At(double t) const {
    Eigen::Vector3d turn;
    for (int axis = 0; axis < 3; ++axis)
      turn(axis) = amplitude_ * std::sin((1.0 + 0.04 * axis) * rate_ * t + phase_ + axis);
    return SE3(ExpSO3(turn), {0.3 + 0.8 * t, -0.2, 0.02 * std::sin(rate_ * t)});
  }

  // The points of a sweep about `at_s`, each from where the sensor was at its time.
  std::vector<TimedCluster> Sweep(const Points& world, double leaf_size_m, double per_s = 1.0,
                                  double at_s = 0.0) const {
    std::vector<TimedPoint> points;
    for (const Eigen::Vector3d& p : world) {
      const Eigen::Vector3d seen = At(at_s).Inverse() * p;
      const double tau = kGapS * (-std::atan2(seen.y(), seen.x()) / (2.0 * M_PI));
      const Eigen::Vector3f q = (At(at_s + tau).Inverse() * p).cast<float>();
      points.push_back({q.x(), q.y(), q.z(), static_cast<float>(per_s * tau)});
    }
    return BuildScanClusters(points, leaf_size_m);
  }

 private:
  double amplitude_, rate_, phase_;
};

}  // namespace lamina
