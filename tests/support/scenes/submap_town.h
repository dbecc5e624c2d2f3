// A town of walls, roofs and poles on a plain, and submaps of drives through it: for tests of place
// recognition and loops.
#pragma once

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>
#include <vector>

#include "backend/submaps/submap.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {

// Houses stand along streets that go round blocks of 60 m; no two are alike.
class Town {
 public:
  explicit Town(std::vector<Facet> facets) : facets_(std::move(facets)) {}
  explicit Town(unsigned seed, double half_m = 130.0) {
    Draws draws(seed);
    for (double x = -half_m; x < half_m; x += 10.0) {
      for (double y = -half_m; y < half_m; y += 10.0)
        facets_.push_back({{x + 5, y + 5, 0}, {5, 0, 0}, {0, 5, 0}});
    }
    for (double x = -half_m; x < half_m; x += 15.0) {
      for (double y = -half_m; y < half_m; y += 15.0) {
        const Eigen::Vector3d at(x + draws.Uniform(0, 6), y + draws.Uniform(0, 6), 0.0);
        if (OnStreet(at)) continue;
        if (draws.Uniform(0, 1) < 0.75) {
          AddHouse(at, &draws);
        } else {
          facets_.push_back({at + Eigen::Vector3d(0, 0, 2), {0.1, 0.1, 0}, {0, 0, 2}});
        }
      }
    }
  }

  // Four walls on the ground around there; half-edges, half the height.
  void AddBox(const Eigen::Vector3d& at, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
              double half_height) {
    const Eigen::Vector3d up(0, 0, half_height), middle = at + up;
    facets_.push_back({middle + a, b, up});
    facets_.push_back({middle - a, b, up});
    facets_.push_back({middle + b, a, up});
    facets_.push_back({middle - b, a, up});
  }

  // The same with cars along the streets of the seeded town, others for each seed.
  Town WithParkedCars(unsigned seed) const {
    constexpr double kStreetM = 60.0, kKerbM = 5.0, kSpaceM = 7.0;
    Town town = *this;
    Draws draws(seed);
    for (double street = -kStreetM; street <= kStreetM; street += kStreetM) {
      for (double along = -80.0; along < 80.0; along += kSpaceM) {
        for (const double side : {-kKerbM, kKerbM}) {
          const double at = along + draws.Uniform(0.0, 2.0);
          if (draws.Uniform(0, 1) < 0.9)
            town.AddBox({at, street + side, 0}, {2.2, 0, 0}, {0, 0.9, 0}, 0.75);
          if (draws.Uniform(0, 1) < 0.9)
            town.AddBox({street + side, at, 0}, {0, 2.2, 0}, {0.9, 0, 0}, 0.75);
        }
      }
    }
    return town;
  }

  // Random points on what lies within `range_m` and no wall hides, about so many to the square
  // metre.
  Points Seen(const Eigen::Vector3d& from, double range_m, double per_m2, Draws* draws) const {
    std::vector<Facet> walls;
    std::copy_if(facets_.begin(), facets_.end(), std::back_inserter(walls), [&](const Facet& f) {
      return f.edge2.z() > 0.0 && (f.centre - from).norm() <= range_m;
    });
    Points points;
    for (const Facet& facet : facets_) {
      if ((facet.centre - from).norm() > range_m) continue;
      const double area = 4.0 * facet.edge1.norm() * facet.edge2.norm();
      for (int i = 0; i < static_cast<int>(per_m2 * area); ++i) {
        const Eigen::Vector3d at = facet.centre + draws->Uniform(-1.0, 1.0) * facet.edge1 +
                                   draws->Uniform(-1.0, 1.0) * facet.edge2;
        if (!Hidden(at, from, walls)) points.push_back(at + 0.01 * draws->InCube(1.7));
      }
    }
    return points;
  }

 private:
  static bool OnStreet(const Eigen::Vector3d& at) {
    const auto near = [](double x) { return std::abs(x - 60.0 * std::round(x / 60.0)) < 8.0; };
    return near(at.x()) || near(at.y());
  }
  void AddHouse(const Eigen::Vector3d& at, Draws* draws) {
    const double angle = draws->Uniform(-0.2, 0.2), height = draws->Uniform(1.5, 4.0);
    const Eigen::Vector3d along(std::cos(angle), std::sin(angle), 0);
    const Eigen::Vector3d across(-along.y(), along.x(), 0);
    const Eigen::Vector3d a = draws->Uniform(2, 5) * along, b = draws->Uniform(2, 5) * across;
    AddBox(at, a, b, height);
  }
  std::vector<Facet> facets_;
};

// A keyframe at a true pose, which odometry takes for `T_world_lidar`.
inline FinalKeyframe KeyframeOf(const Town& town, std::int64_t id, const SE3& T_true_lidar,
                                const SE3& T_world_lidar, double leaf_size_m, Draws* draws,
                                double range_m = 35.0) {
  FinalKeyframe keyframe;
  keyframe.id = id;
  keyframe.stamp_ns = 100000000 * id;
  keyframe.T_world_lidar = T_world_lidar;
  const Points points = town.Seen(T_true_lidar.t, range_m, 2.0, draws);
  for (const PointCluster& c : Untimed(ScanFrom(T_true_lidar, points, leaf_size_m)))
    keyframe.clusters.push_back(c.Moved(T_world_lidar));
  return keyframe;
}

// Poses every 5 m along straight legs between these points, 1.7 m above the ground, looking ahead.
inline std::vector<SE3> Drive(const std::vector<Eigen::Vector2d>& corners) {
  std::vector<SE3> poses;
  for (std::size_t i = 1; i < corners.size(); ++i) {
    const Eigen::Vector2d leg = corners[i] - corners[i - 1];
    const Eigen::Quaterniond ahead(
        Eigen::AngleAxisd(std::atan2(leg.y(), leg.x()), Eigen::Vector3d::UnitZ()));
    const int steps = static_cast<int>(leg.norm() / 5.0);
    for (int k = 0; k < steps; ++k) {
      const Eigen::Vector2d at = corners[i - 1] + leg * k / steps;
      poses.emplace_back(ahead, Eigen::Vector3d(at.x(), at.y(), 1.7));
    }
  }
  return poses;
}

}  // namespace lamina
