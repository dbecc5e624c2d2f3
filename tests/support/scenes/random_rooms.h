// Worlds of planes and poles, scans of them and voxel maps: for tests of matching and odometry.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/map/voxel_map.h"
#include "frontend/scan/scan_clusters.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {

// A rectangle or a line: centre, and half-edges (zero for a line's missing one).
struct Facet {
  Eigen::Vector3d centre, edge1, edge2;

  // Whether a rectangle stands between a sensor and a point that lies on another.
  bool Hides(const Eigen::Vector3d& point, const Eigen::Vector3d& sensor) const {
    const Eigen::Vector3d normal = edge1.cross(edge2), ray = point - sensor;
    const double share = normal.dot(centre - sensor) / normal.dot(ray);
    if (!(share > 0.0 && share < 0.999)) return false;
    const Eigen::Vector3d on = sensor + share * ray - centre;
    return std::abs(on.dot(edge1)) < edge1.squaredNorm() &&
           std::abs(on.dot(edge2)) < edge2.squaredNorm();
  }
};

inline bool Hidden(const Eigen::Vector3d& point, const Eigen::Vector3d& sensor,
                   const std::vector<Facet>& facets) {
  return std::any_of(facets.begin(), facets.end(),
                     [&](const Facet& facet) { return facet.Hides(point, sensor); });
}

class World {
 public:
  std::vector<Facet> facets;

  // Random points on all facets, `per_facet` each, with noise along every axis.
  Points Sample(int per_facet, double sigma_m, Draws* draws) const {
    Points points;
    for (const Facet& facet : facets) {
      for (int i = 0; i < per_facet; ++i) {
        points.push_back(
            facet.centre + draws->Uniform(-1.0, 1.0) * facet.edge1 +
            draws->Uniform(-1.0, 1.0) * facet.edge2 +
            sigma_m * Eigen::Vector3d(draws->Normal(1.0), draws->Normal(1.0), draws->Normal(1.0)));
      }
    }
    return points;
  }

  // Three planes that meet in a corner: enough for a pose, and no more.
  static World Corner() {
    return {{{{5.1, 0, 0}, {0, 5, 0}, {0, 0, 1.5}},
             {{0, 4.3, 0}, {5, 0, 0}, {0, 0, 1.5}},
             {{0, 0, -1.4}, {5, 0, 0}, {0, 4.3, 0}}}};
  }
  // A closed room that every quarter turn about its middle brings upon itself.
  static World Square() {
    World square{{{{0, 0, -1.4}, {4.5, 0, 0}, {0, 4.5, 0}}}};
    for (const double side_m : {-4.5, 4.5}) {
      square.facets.push_back({{side_m, 0, 0}, {0, 4.5, 0}, {0, 0, 1.5}});
      square.facets.push_back({{0, side_m, 0}, {4.5, 0, 0}, {0, 0, 1.5}});
    }
    return square;
  }
  // A closed room without symmetry.
  static World Room() {
    World room = Corner();
    room.facets.push_back({{-5.9, 0, 0}, {0, 4.3, 0}, {0, 0, 1.5}});
    room.facets.push_back({{0, -3.7, 0}, {5, 0, 0}, {0, 0, 1.5}});
    room.facets.push_back({{2.1, -2.9, 0}, {0, 0.8, 0}, {0, 0, 1.5}});
    return room;
  }
  // Two walls and a floor along x, without ends.
  static World Corridor() {
    return {{{{0, 2.1, 0}, {30, 0, 0}, {0, 0, 1.5}},
             {{0, -1.9, 0}, {30, 0, 0}, {0, 0, 1.5}},
             {{0, 0, -1.4}, {30, 0, 0}, {0, 2, 0}}}};
  }
  void AddPoles(Draws* draws) {
    for (int i = 0; i < 30; ++i) {
      const double side = i % 2 == 0 ? 1.2 : -1.2;
      facets.push_back(
          {{i - 15.0 + draws->Uniform(-0.3, 0.3), side + draws->Uniform(-0.2, 0.2), 0.2},
           {0, 0, 1.2},
           {0, 0, 0}});
    }
  }
};

inline std::vector<TimedPoint> StillPoints(const Points& points) {
  std::vector<TimedPoint> timed;
  for (const Eigen::Vector3d& p : points) {
    timed.push_back(
        {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), 0.0F});
  }
  return timed;
}

// Clusters of world points seen from a pose, as from one instant.
inline std::vector<TimedCluster> ScanFrom(const SE3& T_world_lidar, const Points& world,
                                          double leaf_size_m) {
  const SE3 T_lidar_world = T_world_lidar.Inverse();
  Points seen;
  for (const Eigen::Vector3d& p : world) seen.push_back(T_lidar_world * p);
  return BuildScanClusters(StillPoints(seen), leaf_size_m);
}

inline std::vector<PointCluster> Untimed(const std::vector<TimedCluster>& clusters) {
  return DeskewClusters(clusters, SweepMotion());
}

// Puts `frames` samples of a world into a map, each at another pose of the same spot.
inline void FillMap(const World& world, int frames, int per_facet, double sigma_m, Draws* draws,
                    VoxelMap* map) {
  for (std::int64_t frame = 0; frame < frames; ++frame) {
    const SE3 T = draws->Offset(0.3, 0.5);
    const Points points = world.Sample(per_facet, sigma_m, draws);
    for (const PointCluster& c : Untimed(ScanFrom(T, points, map->options().LeafSize()))) {
      const PointCluster in_world = c.Moved(T);
      map->AddWindow(map->LeafAt(in_world.mean), in_world, frame);
    }
  }
  map->Refresh();
}

}  // namespace lamina
