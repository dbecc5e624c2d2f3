#include "backend/registration/batch_cast.h"

#include <gtest/gtest.h>

#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

VoxelMapOptions OneMetre() {
  VoxelMapOptions map;
  map.root_size_m = 1.0;
  return map;
}

// A patch in the middle of a voxel, seen from these poses.
std::vector<BatchFrame> PatchSeenFrom(const std::vector<SE3>& poses, Draws* draws) {
  const World patch{{{{0.5, 0.5, 0.5}, {0, 0.2, 0}, {0, 0, 0.2}}}};
  std::vector<BatchFrame> frames;
  for (std::size_t k = 0; k < poses.size(); ++k) {
    BatchFrame frame;
    frame.stamp_ns = static_cast<StampNs>(k) * 1000000000;
    frame.T_world_lidar = poses[k];
    const Points points = patch.Sample(200, 0.005, draws);
    frame.clusters = ScanFrom(poses[k], points, OneMetre().LeafSize());
    Points seen;
    for (const Eigen::Vector3d& p : points) seen.push_back(poses[k].Inverse() * p);
    frame.points = GroupByCluster(StillPoints(seen), OneMetre().LeafSize());
    frames.push_back(std::move(frame));
  }
  return frames;
}

BundleProblem ProblemSeenFrom(const std::vector<SE3>& poses, bool with_points, Draws* draws) {
  const std::vector<BatchFrame> frames = PatchSeenFrom(poses, draws);
  return BatchCast(frames, poses, OneMetre(), SlidingWindowOptions()).Problem(with_points);
}

TEST(BatchCast, TheSidesOfAWallAreTwoPlanes) {
  Draws draws(7);
  // Frames 1 and 3 stand behind it.
  std::vector<SE3> poses;
  for (int k = 0; k < 5; ++k) {
    poses.emplace_back(draws.Offset(0.3, 0.0).q, Eigen::Vector3d(k % 2 == 0 ? 8.0 : -8.0, 0, 0));
  }
  const BundleProblem problem = ProblemSeenFrom(poses, true, &draws);
  ASSERT_EQ(problem.planes.size(), 2U);
  ASSERT_EQ(problem.observations.size(), 5U);
  EXPECT_EQ(problem.planes[0].count, 3);
  EXPECT_EQ(problem.planes[1].count, 2);
  const int seen_by[] = {0, 2, 4, 1, 3};
  for (std::size_t o = 0; o < 5; ++o) {
    EXPECT_EQ(problem.observations[o].frame, seen_by[o]);
    // The points are those of the observation, and weigh as much.
    double weight = 0.0;
    for (const WeightedPoint& p : problem.points[o]) weight += p.weight;
    EXPECT_EQ(problem.points[o].size(), 200U);
    EXPECT_NEAR(weight, problem.observations[o].cluster.count, 1e-4);
  }
}

TEST(BatchCast, KeepsNoObservationsOfPlanesThatAreLeftOut) {
  Draws draws(8);
  std::vector<SE3> poses = {SE3(Eigen::Quaterniond::Identity(), {8, 0, 0}),
                            SE3(Eigen::Quaterniond::Identity(), {-8, 0, 0}),
                            SE3(Eigen::Quaterniond::Identity(), {8, 1, 0})};
  const BundleProblem problem = ProblemSeenFrom(poses, false, &draws);
  // One frame alone has seen the other side.
  ASSERT_EQ(problem.planes.size(), 1U);
  ASSERT_EQ(problem.observations.size(), 2U);
  EXPECT_EQ(problem.observations[0].frame, 0);
  EXPECT_EQ(problem.observations[1].frame, 2);
}

}  // namespace
}  // namespace lamina
