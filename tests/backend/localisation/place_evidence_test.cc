#include "backend/localisation/place_evidence.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/scenes/mapped_drives.h"

namespace lamina {
namespace {

constexpr double kRoomLeafM = 0.25;

// Seen from within a room of 8 by 6 m: four walls.
World EmptyRoom() {
  return {{{{4, 0, 1.5}, {0, 3, 0}, {0, 0, 1.5}},
           {{-4, 0, 1.5}, {0, 3, 0}, {0, 0, 1.5}},
           {{0, 3, 1.5}, {4, 0, 0}, {0, 0, 1.5}},
           {{0, -3, 1.5}, {4, 0, 0}, {0, 0, 1.5}}}};
}
// Half-way between the middle and the wall.
Facet Board() { return {{2.0, 1.0, 1.2}, {0, 0.8, 0}, {0, 0, 0.8}}; }

FinalKeyframe SeenKeyframe(const World& world, const SE3& T_world_lidar, unsigned seed) {
  Draws draws(seed);
  FinalKeyframe keyframe;
  keyframe.T_world_lidar = T_world_lidar;
  const auto clusters =
      Untimed(ScanFrom(T_world_lidar, world.Sample(8000, 0.005, &draws), kRoomLeafM));
  for (const PointCluster& cluster : clusters)
    keyframe.clusters.push_back(cluster.Moved(T_world_lidar));
  return keyframe;
}

Submap SeenRoom(const World& world, unsigned seed) {
  SubmapBuilder builder(SubmapOptions(), kRoomLeafM);
  builder.Add(SeenKeyframe(world, SE3(Eigen::Quaterniond::Identity(), {0, 0, 1.2}), seed));
  return builder.Current();
}

std::vector<Eigen::Vector3f> Means(const Submap& submap) {
  std::vector<Eigen::Vector3f> means;
  for (const SubmapLeaf& leaf : submap.leaves)
    means.push_back(submap.Cluster(leaf).mean.cast<float>());
  return means;
}

TEST(PlaceEvidence, WhatStandsInTheQueryAloneIsNotMet) {
  World furnished = EmptyRoom();
  furnished.facets.push_back(Board());
  const Submap place = SeenRoom(EmptyRoom(), 1), query = SeenRoom(furnished, 2);
  const OccupiedLeaves leaves(place);
  const SE3 T_place_query = place.T_world_submap.Inverse() * query.T_world_submap;
  EXPECT_GT(leaves.Met(Means(SeenRoom(EmptyRoom(), 3)), T_place_query), 0.995);
  EXPECT_LT(leaves.Met(Means(query), T_place_query), 0.98);
}

TEST(PlaceEvidence, WhatStandsInThePlaceAloneIsGone) {
  World furnished = EmptyRoom();
  furnished.facets.push_back(Board());
  const Submap place = SeenRoom(furnished, 1);
  const std::vector<Eigen::Vector3f> means = Means(place);
  // Of a world of its own, and leaning.
  const SE3 T_own_world(ExpSO3({0.1, -0.05, 1.0}), {7, -3, 2});
  const SE3 T_world_lidar(ExpSO3({0, 0.1, 0}), {-1.0, -0.5, 1.3});
  const auto look = [&](const World& world) {
    FinalKeyframe keyframe = SeenKeyframe(world, T_world_lidar, 5);
    keyframe.T_world_lidar = T_own_world * keyframe.T_world_lidar;
    for (PointCluster& cluster : keyframe.clusters) cluster = cluster.Moved(T_own_world);
    return SightLines({keyframe}, kRoomLeafM).Look(means, T_own_world * place.T_world_submap);
  };
  const SightLines::Seen same = look(furnished), empty = look(EmptyRoom());
  EXPECT_EQ(same.gone, 0);
  EXPECT_GT(same.there, 1000);
  EXPECT_GT(empty.gone, 20);
  EXPECT_LT(empty.GoneShare(), 0.1);
}

TEST(PlaceEvidence, WhatIsHiddenOrOutOfViewIsNotGone) {
  World screened = EmptyRoom();
  screened.facets.push_back(Board());
  // Behind the board, for a sensor that looks along x; and beside a view of the board alone.
  const std::vector<Eigen::Vector3f> behind = {{3.0F, 1.0F, 1.2F}}, beside = {{-2.0F, 0.0F, 1.2F}};
  const SE3 T_world_lidar(Eigen::Quaterniond::Identity(), {0, 1.0, 1.2});
  const SightLines all({SeenKeyframe(screened, T_world_lidar, 1)}, kRoomLeafM);
  EXPECT_EQ(all.Look(behind, SE3()).gone, 0);
  EXPECT_EQ(all.Look(beside, SE3()).gone, 1);
  const SightLines board({SeenKeyframe(World{{Board()}}, T_world_lidar, 1)}, kRoomLeafM);
  EXPECT_EQ(board.Look(beside, SE3()).gone, 0);
}

}  // namespace
}  // namespace lamina
