#include "backend/registration/frame_links.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

// Frames 10 m apart along a road, of which each plane is seen by those that are listed.
BundleProblem Road(int frames, const std::vector<std::vector<int>>& planes) {
  BundleProblem problem;
  for (int k = 0; k < frames; ++k)
    problem.poses.emplace_back(Eigen::Quaterniond::Identity(), Eigen::Vector3d(10.0 * k, 0, 0));
  for (const std::vector<int>& seen_by : planes) {
    Plane plane;
    plane.first = static_cast<std::int32_t>(problem.observations.size());
    plane.count = static_cast<std::int32_t>(seen_by.size());
    for (const int frame : seen_by) problem.observations.push_back({frame, {}});
    problem.planes.push_back(plane);
  }
  return problem;
}

std::vector<int> SeenBy(const BundleProblem& problem, std::size_t plane) {
  std::vector<int> frames;
  const Plane& p = problem.planes.at(plane);
  for (int i = p.first; i < p.first + p.count; ++i)
    frames.push_back(problem.observations.at(static_cast<std::size_t>(i)).frame);
  return frames;
}

TEST(FrameLinks, AChainMaySwingAsAWhole) {
  const BundleProblem problem = Road(4, {{0, 1, 2}, {1, 2, 3}});
  FrameLinks links;
  links.Add(problem);
  std::vector<SE3> swung;
  const SE3 T(ExpSO3({0, 0, 1.0}), {5, 7, 1});
  for (const SE3& pose : problem.poses) swung.push_back(T * pose);
  EXPECT_EQ(links.CutFarther(swung, 0.01, 0.01), 0U);
  EXPECT_LT(links.Between(problem.poses, swung).m, 1e-9);
}

TEST(FrameLinks, WhatIsCarriedApartIsCutAndPlanesPartThere) {
  BundleProblem problem = Road(5, {{0, 1, 2, 3}, {2, 3, 4}, {1, 2}, {0, 1}});
  FrameLinks links;
  links.Add(problem);
  // Little by little, frames 2 to 4 go on by 2 m: no single step is as long as that.
  std::vector<SE3> poses = problem.poses;
  std::size_t cut = 0;
  for (int step = 0; step < 4; ++step) {
    for (std::size_t k = 2; k < 5; ++k) poses[k].t.x() += 0.5;
    cut += links.CutFarther(poses, 1.6, 0.5);
  }
  EXPECT_EQ(cut, 4U);  // 0-2, 0-3, 1-2, 1-3: those across; none of 2-3, 2-4, 3-4, 0-1
  EXPECT_TRUE(links.IsCut(2, 1));
  EXPECT_FALSE(links.IsCut(2, 4));
  links.Apply(&problem);
  ASSERT_EQ(problem.planes.size(), 4U);
  EXPECT_EQ(SeenBy(problem, 0), (std::vector<int>{0, 1}));
  EXPECT_EQ(SeenBy(problem, 1), (std::vector<int>{2, 3}));
  EXPECT_EQ(SeenBy(problem, 2), (std::vector<int>{2, 3, 4}));
  EXPECT_EQ(SeenBy(problem, 3), (std::vector<int>{0, 1}));
}

TEST(FrameLinks, AreCarriedByWhatLeavesItsNeighboursNotByAllTogether) {
  const BundleProblem problem = Road(6, {{0, 1, 2}, {1, 2, 3}, {2, 3, 4}, {4, 5}});
  FrameLinks links;
  links.Add(problem);
  // All turn about the first, so that the last goes 5 m; then frame 3 goes on by itself.
  std::vector<SE3> after;
  const SE3 T(ExpSO3({0, 0, 0.1}), {0, 0, 0});
  for (const SE3& pose : problem.poses) after.push_back(T * pose);
  EXPECT_FALSE(links.AnyFarther(after, 1.6, 0.1));
  after[3].t.z() += 2.0;
  EXPECT_TRUE(links.AnyFarther(after, 1.6, 0.1));
  links.CutFarther(after, 1.6, 0.1);
  EXPECT_FALSE(links.AnyFarther(after, 1.6, 0.1));
}

TEST(FrameLinks, MotionIsThatBetweenNeighbours) {
  const BundleProblem problem = Road(3, {{0, 1}, {1, 2}});
  FrameLinks links;
  links.Add(problem);
  std::vector<SE3> after = problem.poses;
  for (std::size_t k = 1; k < 3; ++k) after[k].t.y() += 0.3;  // one link of two gives way
  EXPECT_NEAR(links.Between(problem.poses, after).m, 0.3 / std::sqrt(2.0), 1e-12);
}

}  // namespace
}  // namespace lamina
