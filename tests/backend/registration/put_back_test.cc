#include "backend/registration/put_back.h"

#include <gtest/gtest.h>

#include "core/geometry/se3.h"

namespace lamina {
namespace {

using Kind = BundleFault::Kind;

TEST(PutPartsBack, WhatNothingLinksFollowsItsNeighbourInTime) {
  std::vector<BatchFrame> frames(6);
  std::vector<SE3> poses;
  const SE3 off(ExpSO3({0, 0.2, 0}), {0, 0, 5});
  const SE3 correction(ExpSO3({0, 0, 0.1}), {0.3, -0.2, 0});
  for (std::size_t k = 0; k < frames.size(); ++k) {
    frames[k].T_world_lidar.t = {static_cast<double>(k), 0, 0};
    poses.push_back(correction * frames[k].T_world_lidar);
  }
  // 0 is alone where it began, 5 where a round has carried it; 3 and 4 hang together, carried off
  // by a round as well.
  poses[0] = frames[0].T_world_lidar;
  poses[5] = frames[5].T_world_lidar * off;
  poses[3] = off * poses[3];
  poses[4] = off * poses[4] * SE3(ExpSO3({0.01, 0, 0}), {0, 0, 0});
  const SE3 T_3_4 = poses[3].Inverse() * poses[4];
  const std::vector<SE3> before = poses;
  BundleFault alone, last, group;
  alone.frame = 0;
  last.frame = 5;
  group.kind = Kind::kApart;
  group.frame = 3;
  group.group = {3, 4};
  PutPartsBack(frames, {alone, last, group}, &poses);
  for (const std::size_t k : {3U, 5U}) {
    const SE3 expected = correction * frames[k].T_world_lidar;
    EXPECT_LT((poses[k].t - expected.t).norm(), 1e-12) << k;
    EXPECT_LT(RotationAngle(poses[k], expected), 1e-7) << k;
  }
  const SE3 after = poses[3].Inverse() * poses[4];
  EXPECT_LT((after.t - T_3_4.t).norm(), 1e-12);
  EXPECT_LT(RotationAngle(after, T_3_4), 1e-7);
  for (const std::size_t k : {0U, 1U, 2U}) EXPECT_EQ(poses[k].t, before[k].t);
}

}  // namespace
}  // namespace lamina
