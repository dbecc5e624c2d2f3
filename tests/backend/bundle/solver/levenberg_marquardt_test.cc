#include "backend/bundle/solver/levenberg_marquardt.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "backend/bundle/block_pattern.h"
#include "backend/bundle/condensed_cost.h"
#include "backend/bundle/index.h"
#include "backend/bundle/solver/adjuster.h"
#include "tests/support/scenes/random_bundles.h"

namespace lamina {
namespace {

constexpr int kStepFrames = 70;

// A drive along a street and back: each plane is seen by a few neighbours, and by those that come
// by later. More unknowns than the solver takes for few.
BundleProblem StreetAndBack(unsigned seed) {
  Draws draws(seed);
  std::vector<SE3> truth;
  BundleProblem problem;
  for (int k = 0; k < kStepFrames; ++k) {
    const double x = std::min(k, kStepFrames - k);
    truth.emplace_back(draws.Offset(0.1, 0.0).q, Eigen::Vector3d(x, 0, 0));
    const SE3 off = k == 0 ? SE3() : draws.Offset(0.005, 0.02);
    problem.poses.emplace_back(truth.back().q * off.q, truth.back().t + off.t);
  }
  for (int p = 0; p < 8 * kStepFrames; ++p) {
    const Eigen::Vector3d at(0.5 * p / 8.0, 0, 0);
    const Patch patch(at + draws.InCube(4.0), draws.Direction());
    Plane plane;
    plane.first = static_cast<std::int32_t>(problem.observations.size());
    plane.weight = 400.0;
    for (int k = 0; k < kStepFrames; ++k) {
      const SE3& T = truth[static_cast<std::size_t>(k)];
      if (std::abs(T.t.x() - at.x()) > 2.0) continue;
      Points seen;
      for (int i = 0; i < 10; ++i) seen.push_back(T.Inverse() * patch.Point(1.0, 0.02, &draws));
      problem.observations.push_back({k, ClusterOf(seen)});
      ++plane.count;
    }
    problem.planes.push_back(plane);
  }
  return problem;
}

BundleResult Solve(const BundleProblem& problem, bool may_keep) {
  CondensedCost cost(problem);
  return MinimiseByLevenbergMarquardt(problem, &cost, {200, 1e-13, 6}, nullptr, may_keep);
}

TEST(LevenbergMarquardt, AKeptHessianLeadsToTheSameMinimum) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    const BundleProblem problem = StreetAndBack(seed);
    const BundleResult fresh = Solve(problem, false), kept = Solve(problem, true);
    ASSERT_EQ(fresh.status, BundleResult::Status::kConverged);
    ASSERT_EQ(kept.status, BundleResult::Status::kConverged);
    EXPECT_LT(kept.final_cost, 0.8 * kept.initial_cost);
    EXPECT_NEAR(kept.final_cost, fresh.final_cost, 1e-9 * fresh.final_cost);
    EXPECT_LE(kept.iterations, 3 * fresh.iterations);
    for (std::size_t k = 0; k < kept.poses.size(); ++k)
      EXPECT_LT((kept.poses[k].t - fresh.poses[k].t).norm(), 1e-4) << k;
  }
}

TEST(LevenbergMarquardt, TheSparseWayMeetsTheDenseMinimumWithTheSameBitsAtAnyNumberOfThreads) {
  BundleProblem problem = StreetAndBack(4);
  ASSERT_LT(BlockPattern(problem, BundleIndex(problem)).Density(), 0.5);
  const BundleResult sparse = Solve(problem, true);
  for (const std::size_t threads : {1U, 3U}) {
    const ThreadLimit limit(threads);
    const BundleResult again = Solve(problem, true);
    EXPECT_EQ(again.final_cost, sparse.final_cost);
    for (std::size_t k = 0; k < sparse.poses.size(); ++k) {
      EXPECT_EQ(again.poses[k].t, sparse.poses[k].t) << threads << " threads, frame " << k;
      EXPECT_EQ(again.poses[k].q.coeffs(), sparse.poses[k].q.coeffs());
    }
  }
  // Priors that say nothing fill every block.
  for (int a = 0; a < kStepFrames; ++a) {
    for (int b = a + 1; b < kStepFrames; ++b)
      problem.priors.push_back({a, b, SE3(), Matrix6d::Zero()});
  }
  const BundleResult dense = Solve(problem, false);
  EXPECT_NEAR(sparse.final_cost, dense.final_cost, 1e-9 * dense.final_cost);
}

// A long chain, each plane seen by few neighbours: the sparse path must give the dense one's poses.
TEST(LevenbergMarquardt, SparseAndDenseFactorisationsAgree) {
  Draws draws(10);
  BundleScene scene;
  const int frames = 80;
  for (int k = 0; k < frames; ++k) {
    scene.truth.emplace_back(draws.Offset(0.1, 0.0).q, Eigen::Vector3d(0.5 * k, 0, 0));
    const SE3 off = k == 0 ? SE3() : draws.Offset(0.01, 0.03);
    scene.problem.poses.emplace_back(scene.truth.back().q * off.q, scene.truth.back().t + off.t);
  }
  for (int p = 0; p < 12 * frames; ++p) {
    const int at = p / 12;
    const Patch patch(Eigen::Vector3d(0.5 * at, 0, 0) + draws.InCube(3.0), draws.Direction());
    Plane plane;
    plane.first = static_cast<std::int32_t>(scene.problem.observations.size());
    for (int k = std::max(0, at - 2); k <= std::min(frames - 1, at + 2); ++k, ++plane.count) {
      const SE3 T_lidar_world = scene.truth[static_cast<std::size_t>(k)].Inverse();
      Points seen;
      for (int i = 0; i < 10; ++i) seen.push_back(T_lidar_world * patch.Point(1.0, 0.005, &draws));
      scene.problem.observations.push_back({k, ClusterOf(seen)});
    }
    scene.problem.planes.push_back(plane);
  }
  // Priors along the chain, and one across it that closes a loop.
  for (int k = 1; k < frames; ++k) {
    const auto i = static_cast<std::size_t>(k);
    scene.problem.priors.push_back(
        {k - 1, k, scene.truth[i - 1].Inverse() * scene.truth[i], 10.0 * Matrix6d::Identity()});
  }
  scene.problem.priors.push_back(
      {frames - 1, 0, scene.truth.back().Inverse() * scene.truth[0], 5.0 * Matrix6d::Identity()});
  // A frame in the middle that does not rise, whatever its priors say.
  scene.problem.holds.push_back({frames / 2, Vector6d::Unit(5)});
  ASSERT_LT(BlockPattern(scene.problem, BundleIndex(scene.problem)).Density(), 0.25);
  BundleAdjusterOptions options{100, 1e-14, 3};
  const BundleResult sparse = AdjustBundle(scene.problem, options);
  // Priors that say nothing between all frames make the solver take the dense way.
  for (int a = 0; a < frames; ++a) {
    for (int b = a + 1; b < frames; ++b)
      scene.problem.priors.push_back({a, b, SE3(), Matrix6d::Zero()});
  }
  const BundleResult dense = AdjustBundle(scene.problem, options);
  EXPECT_TRUE(sparse.usable());
  EXPECT_LT(sparse.final_cost, 0.1 * sparse.initial_cost);
  EXPECT_NEAR(sparse.final_cost, dense.final_cost, 1e-9 * dense.final_cost);
  for (std::size_t k = 0; k < dense.poses.size(); ++k) {
    EXPECT_LT(RotationAngle(sparse.poses[k], dense.poses[k]), 1e-6) << k;
    EXPECT_LT((sparse.poses[k].t - dense.poses[k].t).norm(), 1e-6) << k;
  }
}

}  // namespace
}  // namespace lamina
