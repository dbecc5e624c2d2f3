#include "backend/pieces/first_pose.h"

#include <gtest/gtest.h>

#include "core/base/angle.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

// Ten scans of a way through these walls, the first one where `first` says it was.
std::optional<SE3> FirstOf(const World& world, const SE3& off) {
  Draws draws(5);
  const VoxelMapOptions map;
  std::deque<WindowFrame> frames;
  for (int i = 0; i < 10; ++i) {
    const SE3 truth(ExpSO3(0.02 * i * Eigen::Vector3d::UnitZ()), {0.05 * i, 0.02 * i, 0.1});
    WindowFrame& frame = frames.emplace_back();
    frame.T_world_lidar = i == 0 ? truth * off : truth;
    frame.deskewed = Untimed(ScanFrom(truth, world.Sample(1500, 0.01, &draws), map.LeafSize()));
  }
  constexpr double kUsualInliers = 0.8;
  return FirstPoseByOthers(frames, kUsualInliers, OdometryOptions(), map);
}

TEST(FirstPose, OneThatLiesAsideIsFoundInTheMapOfTheOthers) {
  const SE3 truth(Eigen::Quaterniond::Identity(), {0, 0, 0.1});
  for (const double degrees : {3.0, 9.0}) {
    const SE3 off(ExpSO3(Radians(degrees) * Eigen::Vector3d::UnitZ()), {0.15, -0.1, 0.05});
    const std::optional<SE3> found = FirstOf(World::Room(), off);
    ASSERT_TRUE(found.has_value()) << degrees;
    EXPECT_LT((found->t - truth.t).norm(), 0.02);
    EXPECT_LT(RotationAngle(*found, truth), Radians(0.3));
  }
}

TEST(FirstPose, OneThatIsRightStays) {
  EXPECT_FALSE(FirstOf(World::Room(), SE3()).has_value());
  // What bundle adjustment settles.
  EXPECT_FALSE(
      FirstOf(World::Room(), SE3(Eigen::Quaterniond::Identity(), {0.01, 0, 0})).has_value());
}

// Along a corridor nothing tells the pose.
TEST(FirstPose, WhatPlanesLeaveOpenStays) {
  World corridor;
  for (const double side : {-1.0, 1.0})
    corridor.facets.push_back({{0, 2 * side, 0}, {20, 0, 0}, {0, 0, 1.5}});
  corridor.facets.push_back({{0, 0, -1.5}, {20, 0, 0}, {0, 2, 0}});
  EXPECT_FALSE(FirstOf(corridor, SE3(Eigen::Quaterniond::Identity(), {0.4, 0.1, 0})).has_value());
}

}  // namespace
}  // namespace lamina
