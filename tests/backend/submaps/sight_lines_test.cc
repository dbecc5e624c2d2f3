#include "backend/submaps/sight_lines.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/scenes/seen_rooms.h"

namespace lamina {
namespace {

TEST(SightLines, WhatStandsInThePlaceAloneIsGone) {
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

TEST(SightLines, WhatIsHiddenOrOutOfViewIsNotGone) {
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

// As seen from a submap's own keyframe, 1.2 m above the floor.
TEST(SightLines, ASubmapSeesPastWhatAnotherHasInFrontOfItsWalls) {
  World furnished = EmptyRoom();
  furnished.facets.push_back(Board());
  const Submap with = SeenRoom(furnished, 1), again = SeenRoom(furnished, 2),
               without = SeenRoom(EmptyRoom(), 3);
  const SightLines past(without, without.Leaves());
  const SE3 T_without_with = without.T_world_submap.Inverse() * with.T_world_submap;
  EXPECT_EQ(SightLines(again, again.Leaves()).Look(Means(with), SE3()).gone, 0);
  EXPECT_GT(past.Look(Means(with), T_without_with).gone, 5);
  // What one has not, it does not miss: it never saw behind.
  EXPECT_EQ(SightLines(with, with.Leaves()).Look(Means(without), T_without_with.Inverse()).gone, 0);
  // The board ends 0.8 m above the sensor.
  const Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  EXPECT_GT(past.LookAbove(Means(with), T_without_with, up, 0.2).gone, 0);
  EXPECT_EQ(past.LookAbove(Means(with), T_without_with, up, 0.9).gone, 0);
  EXPECT_GT(past.LookAbove(Means(with), T_without_with, up, 0.9).there, 50);
  EXPECT_EQ(SightLines().Look(Means(with), SE3()).GoneShare(), 0.0);
}

}  // namespace
}  // namespace lamina
