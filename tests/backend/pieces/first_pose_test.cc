#include "backend/pieces/first_pose.h"

#include <gtest/gtest.h>

#include "core/base/angle.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

SE3 TrueAt(int i) {
  return SE3(ExpSO3(0.02 * i * Eigen::Vector3d::UnitZ()), {0.05 * i, 0.02 * i, 0.1});
}

// Of ten scans of a way through these walls, of which the first `aside` lie off where they were.
std::vector<SE3> FirstOf(const World& world, const SE3& off, int aside = 1) {
  Draws draws(5);
  const VoxelMapOptions map;
  std::deque<WindowFrame> frames;
  for (int i = 0; i < 10; ++i) {
    const SE3 truth = TrueAt(i);
    WindowFrame& frame = frames.emplace_back();
    frame.T_world_lidar = i < aside ? truth * off : truth;
    frame.deskewed = Untimed(ScanFrom(truth, world.Sample(1500, 0.01, &draws), map.LeafSize()));
  }
  constexpr double kUsualInliers = 0.8;
  return FirstPosesByOthers(frames, kUsualInliers, OdometryOptions(), map);
}

TEST(FirstPose, OneThatLiesAsideIsFoundInTheMapOfTheOthers) {
  for (const double degrees : {3.0, 9.0}) {
    const SE3 off(ExpSO3(Radians(degrees) * Eigen::Vector3d::UnitZ()), {0.15, -0.1, 0.05});
    const std::vector<SE3> found = FirstOf(World::Room(), off);
    ASSERT_EQ(found.size(), 1U) << degrees;
    EXPECT_LT((found[0].t - TrueAt(0).t).norm(), 0.02);
    EXPECT_LT(RotationAngle(found[0], TrueAt(0)), Radians(0.3));
  }
}

TEST(FirstPose, ThoseThatLieAsideTogetherAreFoundTogether) {
  const SE3 off(ExpSO3(Radians(2.0) * Eigen::Vector3d::UnitZ()), {0.06, -0.05, 0.02});
  const std::vector<SE3> found = FirstOf(World::Room(), off, 4);
  ASSERT_EQ(found.size(), 4U);
  for (int i = 0; i < 4; ++i) {
    const SE3& pose = found[static_cast<std::size_t>(i)];
    EXPECT_LT((pose.t - TrueAt(i).t).norm(), 0.02) << i;
    EXPECT_LT(RotationAngle(pose, TrueAt(i)), Radians(0.3)) << i;
  }
}

TEST(FirstPose, OneThatIsRightStays) {
  EXPECT_TRUE(FirstOf(World::Room(), SE3()).empty());
  // What bundle adjustment settles.
  EXPECT_TRUE(FirstOf(World::Room(), SE3(Eigen::Quaterniond::Identity(), {0.01, 0, 0})).empty());
}

// Along a corridor nothing tells the pose.
TEST(FirstPose, WhatPlanesLeaveOpenStays) {
  World corridor;
  for (const double side : {-1.0, 1.0})
    corridor.facets.push_back({{0, 2 * side, 0}, {20, 0, 0}, {0, 0, 1.5}});
  corridor.facets.push_back({{0, 0, -1.5}, {20, 0, 0}, {0, 2, 0}});
  EXPECT_TRUE(FirstOf(corridor, SE3(Eigen::Quaterniond::Identity(), {0.4, 0.1, 0})).empty());
}

}  // namespace
}  // namespace lamina
