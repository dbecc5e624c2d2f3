// A street between two facades of bays that stand out by 0 to 1.5 m, with side faces between them,
// scanned by rays: what faces along the street is little, and enough.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "core/base/angle.h"
#include "frontend/scan/scan_clusters.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {

class BayStreet {
 public:
  explicit BayStreet(unsigned seed) {
    Draws draws(seed);
    for (auto& side : depths_) {
      for (double& depth : side) depth = draws.Uniform(0.0, 1.5);
    }
  }

  // Range along a ray (unit direction); infinite where it meets the sky.
  double Cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const {
    double nearest = std::numeric_limits<double>::infinity();
    if (direction.z() < 0.0) nearest = -origin.z() / direction.z();
    const std::size_t side = direction.y() > 0.0 ? 1 : 0;
    const double across = std::abs(direction.y());
    const double lateral = side == 1 ? origin.y() : -origin.y();
    auto bay = static_cast<std::int64_t>(std::floor(origin.x() / kBayM));
    double entered = 0.0;
    while (entered < std::min(nearest, kRangeM)) {
      const double facade = kHalfWidthM - Depth(side, bay);
      const double at_facade = across > 1e-9 ? std::max(entered, (facade - lateral) / across)
                                             : std::numeric_limits<double>::infinity();
      const double edge = kBayM * static_cast<double>(bay + (direction.x() >= 0.0 ? 1 : 0));
      const double leaving = std::abs(direction.x()) > 1e-9
                                 ? (edge - origin.x()) / direction.x()
                                 : std::numeric_limits<double>::infinity();
      if (at_facade <= leaving) {
        const double z = origin.z() + at_facade * direction.z();
        return z < kHeightM ? std::min(nearest, at_facade) : nearest;
      }
      entered = leaving;
      bay += direction.x() >= 0.0 ? 1 : -1;
    }
    return nearest;
  }

  // Points of a scan from one instant, with 1 cm of noise along the ray.
  std::vector<TimedPoint> Scan(const SE3& T_world_lidar, int points, Draws* draws) const {
    std::vector<TimedPoint> scan;
    while (static_cast<int>(scan.size()) < points) {
      const double azimuth = draws->Uniform(-M_PI, M_PI);
      const double elevation = draws->Uniform(-25.0, 15.0) * kDegree;
      const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                      std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      const double range = Cast(T_world_lidar.t, T_world_lidar.q * direction);
      if (range > kRangeM) continue;
      const Eigen::Vector3f p = ((range + draws->Normal(0.01)) * direction).cast<float>();
      scan.push_back({p.x(), p.y(), p.z(), 0.0F});
    }
    return scan;
  }

  // Points along the same rays in each scan: `rings` of them 2 deg apart, each of `steps`, the
  // first of them at that share of a step.
  std::vector<TimedPoint> RingScan(const SE3& T_world_lidar, int rings, int steps, Draws* draws,
                                   double first = 0.0) const {
    std::vector<TimedPoint> scan;
    for (int ring = 0; ring < rings; ++ring) {
      const double elevation = (2.0 * ring - rings + 1.0) * kDegree;
      for (int step = 0; step < steps; ++step) {
        const double azimuth = 2.0 * M_PI * (step + first) / steps;
        const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                        std::cos(elevation) * std::sin(azimuth),
                                        std::sin(elevation));
        const double range = Cast(T_world_lidar.t, T_world_lidar.q * direction);
        if (range > kRangeM) continue;
        const Eigen::Vector3f p = ((range + draws->Normal(0.01)) * direction).cast<float>();
        scan.push_back({p.x(), p.y(), p.z(), 0.0F});
      }
    }
    return scan;
  }

  // Rain and spray: returns from within a few metres, nothing else.
  static std::vector<TimedPoint> Spray(int points, Draws* draws) {
    std::vector<TimedPoint> scan;
    for (int i = 0; i < points; ++i) {
      const Eigen::Vector3f p = (draws->Uniform(1.5, 6.0) * draws->Direction()).cast<float>();
      scan.push_back({p.x(), p.y(), p.z(), 0.0F});
    }
    return scan;
  }

  static SE3 PoseAt(double along_m) {
    return SE3(Eigen::Quaterniond::Identity(),
               {along_m + 2.3, 0.2 * std::sin(0.05 * along_m), 1.8});
  }

 private:
  static constexpr double kBayM = 5.0, kHalfWidthM = 8.0, kHeightM = 12.0, kRangeM = 100.0;
  static constexpr std::size_t kBays = 256;

  double Depth(std::size_t side, std::int64_t bay) const {
    return depths_[side][static_cast<std::size_t>(bay) % kBays];
  }

  std::array<std::array<double, kBays>, 2> depths_;
};

}  // namespace lamina
