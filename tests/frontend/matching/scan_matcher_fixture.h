// Worlds that scans are matched in.
#pragma once

#include <vector>

#include "frontend/matching/scan_matcher.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {

// A map of a world, and scans to match with it.
struct Stage {
  Stage(const World& w, unsigned seed) : world(w), draws(seed), map(VoxelMapOptions()) {
    FillMap(world, 5, 3000, 0.005, &draws, &map);
  }
  std::vector<PointCluster> Scan(const SE3& T_world_lidar) {
    return Untimed(
        ScanFrom(T_world_lidar, world.Sample(2000, 0.005, &draws), map.options().LeafSize()));
  }

  World world;
  Draws draws;
  VoxelMap map;
};

// A prediction that is off by about what constant velocity is at 10 Hz.
inline PosePrediction Predicted(const SE3& T) {
  PosePrediction prediction;
  prediction.T_world_lidar = T;
  prediction.covariance.diagonal() << Eigen::Vector3d::Constant(1e-3),
      Eigen::Vector3d::Constant(1e-3);
  return prediction;
}

}  // namespace lamina
