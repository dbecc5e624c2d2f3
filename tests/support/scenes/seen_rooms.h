// A room, empty or with a board in it, as keyframes and submaps see it: for tests of what one of
// two maps has and the other has not.
#pragma once

#include <vector>

#include "backend/submaps/submap.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {

inline constexpr double kRoomLeafM = 0.25;

// Seen from within a room of 8 by 6 m: four walls.
inline World EmptyRoom() {
  return {{{{4, 0, 1.5}, {0, 3, 0}, {0, 0, 1.5}},
           {{-4, 0, 1.5}, {0, 3, 0}, {0, 0, 1.5}},
           {{0, 3, 1.5}, {4, 0, 0}, {0, 0, 1.5}},
           {{0, -3, 1.5}, {4, 0, 0}, {0, 0, 1.5}}}};
}
// Half-way between the middle and the wall.
inline Facet Board() { return {{2.0, 1.0, 1.2}, {0, 0.8, 0}, {0, 0, 0.8}}; }

inline FinalKeyframe SeenKeyframe(const World& world, const SE3& T_world_lidar, unsigned seed) {
  Draws draws(seed);
  FinalKeyframe keyframe;
  keyframe.T_world_lidar = T_world_lidar;
  const auto clusters =
      Untimed(ScanFrom(T_world_lidar, world.Sample(8000, 0.005, &draws), kRoomLeafM));
  for (const PointCluster& cluster : clusters)
    keyframe.clusters.push_back(cluster.Moved(T_world_lidar));
  return keyframe;
}

inline Submap SeenRoom(const World& world, unsigned seed) {
  SubmapBuilder builder(SubmapOptions(), kRoomLeafM);
  builder.Add(SeenKeyframe(world, SE3(Eigen::Quaterniond::Identity(), {0, 0, 1.2}), seed));
  return builder.Current();
}

inline std::vector<Eigen::Vector3f> Means(const Submap& submap) {
  std::vector<Eigen::Vector3f> means;
  for (const SubmapLeaf& leaf : submap.leaves)
    means.push_back(submap.Cluster(leaf).mean.cast<float>());
  return means;
}

}  // namespace lamina
