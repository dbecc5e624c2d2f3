#include "backend/anchors/anchor_graph.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "core/base/angle.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

Matrix6d Information(double rotation_sigma, double translation_sigma) {
  Vector6d information;
  information << Eigen::Vector3d::Constant(1.0 / (rotation_sigma * rotation_sigma)),
      Eigen::Vector3d::Constant(1.0 / (translation_sigma * translation_sigma));
  return information.asDiagonal();
}

struct Problem {
  AnchorGraph graph;
  std::vector<SE3> truth;

  double Error(const std::vector<SE3>& poses) const {
    double square = 0.0;
    for (std::size_t i = 0; i < poses.size(); ++i)
      square += (poses[i].t - truth[i].t).squaredNorm();
    return std::sqrt(square / static_cast<double>(poses.size()));
  }
};

// Three laps of 40 submaps round a square, whose odometry drifts by 1 % and turns; each submap of
// the later laps has a loop to the lap before.
Problem Laps(unsigned seed) {
  constexpr int kLap = 40, kLaps = 3;
  constexpr double kRotation = 0.3 * kDegree, kTranslation = 0.3;
  Draws draws(seed);
  Problem problem;
  for (int i = 0; i < kLap * kLaps; ++i) {
    const double angle = 2.0 * M_PI * i / kLap;
    problem.truth.emplace_back(
        Eigen::Quaterniond(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ())),
        Eigen::Vector3d(200.0 * std::sin(angle), 200.0 - 200.0 * std::cos(angle), 0.0));
  }
  const auto measured = [&](std::size_t from, std::size_t to, double rotation, double translation) {
    const SE3 error(
        ExpSO3(Eigen::Vector3d(draws.Normal(rotation), draws.Normal(rotation),
                               draws.Normal(rotation))),
        {draws.Normal(translation), draws.Normal(translation), draws.Normal(translation)});
    return AnchorEdge{from, to, problem.truth[from].Inverse() * problem.truth[to] * error,
                      Information(rotation, translation)};
  };
  AnchorGraph& graph = problem.graph;
  graph.poses.push_back(problem.truth[0]);
  for (std::size_t i = 1; i < problem.truth.size(); ++i) {
    graph.odometry.push_back(measured(i - 1, i, kRotation, kTranslation));
    graph.poses.push_back(graph.poses.back() * graph.odometry.back().T_from_to);
  }
  for (std::size_t i = kLap; i < problem.truth.size(); ++i)
    graph.loops.push_back(measured(i - kLap, i, 0.1 * kDegree, 0.05));
  return problem;
}

TEST(AnchorGraph, WhatCannotBeSolvedStaysAsItWas) {
  Problem problem = Laps(1);
  AnchorGraph& graph = problem.graph;
  graph.kept_before.assign(graph.loops.size(), true);
  graph.kept_before.back() = false;
  graph.loops.back().information(0, 0) = std::nan("");
  const AnchorGraphResult result = SolveAnchorGraph(graph, {});
  ASSERT_FALSE(result.good);
  EXPECT_EQ(result.kept, graph.kept_before);
  for (std::size_t i = 0; i < graph.poses.size(); ++i)
    EXPECT_EQ(result.poses[i].t, graph.poses[i].t);
  EXPECT_EQ(WhyLeftOut(result), "could not be solved with: " + result.reason);
  EXPECT_FALSE(result.reason.empty());
}

TEST(AnchorGraph, LoopsTakeBackTheDrift) {
  const Problem problem = Laps(1);
  const AnchorGraphResult result = SolveAnchorGraph(problem.graph, {});
  ASSERT_TRUE(result.good) << result.reason;
  EXPECT_LT(problem.Error(result.poses), 0.5 * problem.Error(problem.graph.poses));
  EXPECT_LT(result.cost, result.cost_before);
  for (const bool kept : result.kept) EXPECT_TRUE(kept);
  EXPECT_EQ(result.poses[0].t, problem.graph.poses[0].t);
  // Six numbers an edge less six a pose: what noise leaves of a sum of squares.
  const double expected = 6.0 * static_cast<double>(problem.graph.loops.size());
  EXPECT_NEAR(result.cost, expected, 0.25 * expected);
}

TEST(AnchorGraph, AFifthOfWrongLoopsChangesLittle) {
  for (const unsigned seed : {4U, 7U, 10U}) {
    Problem problem = Laps(seed);
    const AnchorGraphResult clean = SolveAnchorGraph(problem.graph, {});
    const std::size_t right = problem.graph.loops.size();
    Draws draws(100 + seed);
    const int poses = static_cast<int>(problem.truth.size());
    // A quarter as many as the right ones: a fifth of all. Some of them agree with one another, as
    // those of an alias do.
    const SE3 alias(Eigen::Quaterniond::Identity(), {15.0, 4.0, 0.0});
    for (std::size_t i = 0; i < right / 4; ++i) {
      const auto from = static_cast<std::size_t>(draws.Integer(0, poses / 2));
      const auto to = static_cast<std::size_t>(draws.Integer(poses / 2 + 1, poses - 1));
      SE3 wrong = i % 2 == 0 ? SE3(ExpSO3({0, 0, draws.Uniform(-3.1, 3.1)}), draws.InCube(20.0))
                             : problem.truth[from].Inverse() * alias * problem.truth[to];
      problem.graph.loops.push_back({from, to, wrong, Information(0.1 * kDegree, 0.05)});
    }
    const AnchorGraphResult result = SolveAnchorGraph(problem.graph, {});
    ASSERT_TRUE(result.good);
    EXPECT_LT(problem.Error(result.poses), 1.1 * problem.Error(clean.poses)) << "seed " << seed;
    for (std::size_t i = right; i < result.kept.size(); ++i)
      EXPECT_FALSE(result.kept[i]) << "seed " << seed;
  }
}

TEST(AnchorGraph, AWrongLoopOverAShortWayDoesNotBendOdometry) {
  Problem problem = Laps(3);
  const AnchorGraphResult clean = SolveAnchorGraph(problem.graph, {});
  const SE3 alias(Eigen::Quaterniond::Identity(), {6.0, 0.0, 0.0});
  problem.graph.loops.push_back({50, 53, problem.truth[50].Inverse() * problem.truth[53] * alias,
                                 Information(0.1 * kDegree, 0.05)});
  const AnchorGraphResult result = SolveAnchorGraph(problem.graph, {});
  EXPECT_FALSE(result.kept.back());
  EXPECT_NEAR(problem.Error(result.poses), problem.Error(clean.poses), 1e-3);
}

TEST(AnchorGraph, ASolveGoesOnFromTheLoopsKeptBefore) {
  Problem problem = Laps(4);
  const AnchorGraphResult whole = SolveAnchorGraph(problem.graph, {});
  problem.graph.kept_before.assign(problem.graph.loops.size() - 5, true);
  problem.graph.poses = whole.poses;
  const AnchorGraphResult again = SolveAnchorGraph(problem.graph, {});
  EXPECT_LT(again.iterations, whole.iterations);
  EXPECT_NEAR(again.cost, whole.cost, 1e-3 * whole.cost);
}

TEST(AnchorGraph, PartsThatNothingJoinsKeepTheirFirstPose) {
  Draws draws(2);
  AnchorGraph graph;
  for (int i = 0; i < 4; ++i) graph.poses.push_back(draws.Pose(10.0));
  const SE3 step(Eigen::Quaterniond::Identity(), {1, 0, 0});
  graph.odometry = {{0, 1, step, Information(0.1, 0.1)}, {2, 3, step, Information(0.1, 0.1)}};
  const AnchorGraphResult result = SolveAnchorGraph(graph, {});
  ASSERT_TRUE(result.good);
  EXPECT_EQ(result.poses[2].t, graph.poses[2].t);
  EXPECT_LT((result.poses[3].t - (graph.poses[2] * step).t).norm(), 1e-6);
  graph.odometry.push_back({0, 9, step, Information(1, 1)});
  EXPECT_THROW(SolveAnchorGraph(graph, {}), std::out_of_range);
}

TEST(AnchorGraph, FixedPosesStayWhereTheyAre) {
  const auto at = [](double x) { return SE3(Eigen::Quaterniond::Identity(), {x, 0.0, 0.0}); };
  AnchorGraph graph;
  graph.poses = {at(0.0), at(1.1), at(2.3)};
  graph.odometry = {{0, 1, at(1.0), Information(0.1, 0.1)}, {1, 2, at(1.0), Information(0.1, 0.1)}};
  graph.fixed = {2};
  AnchorGraphResult result = SolveAnchorGraph(graph, {});
  ASSERT_TRUE(result.good);
  EXPECT_EQ(result.poses[2].t.x(), 2.3);
  EXPECT_NEAR(result.poses[0].t.x(), 0.3, 1e-6);
  graph.fixed = {0, 2};
  result = SolveAnchorGraph(graph, {});
  EXPECT_EQ(result.poses[0].t.x(), 0.0);
  EXPECT_EQ(result.poses[2].t.x(), 2.3);
  EXPECT_NEAR(result.poses[1].t.x(), 1.15, 1e-6);
}

TEST(AnchorGraph, NothingIsSolvedAtOnce) {
  EXPECT_TRUE(SolveAnchorGraph({}, {}).good);
  AnchorGraph one;
  one.poses.emplace_back();
  EXPECT_EQ(SolveAnchorGraph(one, {}).poses.size(), 1U);
}

}  // namespace
}  // namespace lamina
