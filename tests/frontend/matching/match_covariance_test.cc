// What a match says of its own errors.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>

#include "core/map/voxel_key.h"
#include "frontend/matching/scan_matcher.h"
#include "tests/frontend/matching/scan_matcher_fixture.h"
#include "tests/support/saved_map.h"

namespace lamina {
namespace {

// Ids of nodes follow the order in which roots were made; loaded, that in which they were touched.
TEST(MatchCovariance, HasTheSameBitsInAMapThatWasLoaded) {
  World small = World::Corner();  // most of a pose is held by one block of space
  for (auto& facet : small.facets) {
    facet.centre *= 0.3;
    facet.edge1 *= 0.3;
    facet.edge2 *= 0.3;
  }
  VoxelMapOptions options;
  options.root_size_m = 0.8;
  Draws draws(3);
  VoxelMap map(options), loaded(options);
  FillMap(small, 5, 3000, 0.005, &draws, &map);
  // Touched in another order than made.
  Points corner = small.Sample(40, 0.0, &draws);
  std::sort(corner.begin(), corner.end(),
            [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) { return a.z() < b.z(); });
  for (const Eigen::Vector3d& p : corner) map.LeafAt(p);
  map.Refresh();
  const std::string records = Saved(&map);
  loaded.Load(records);
  loaded.FinishLoading();
  const ScanMatcher matcher{ScanMatcherOptions()};
  for (int i = 0; i < 20; ++i) {
    const SE3 truth = draws.Offset(0.05, 0.1);
    const auto scan = Untimed(ScanFrom(truth, small.Sample(800, 0.01, &draws), options.LeafSize()));
    const MatchResult made = matcher.Match(scan, Predicted(truth), map);
    const MatchResult again = matcher.Match(scan, Predicted(truth), loaded);
    ASSERT_NE(made.status, MatchResult::Status::kTooFewMatches);
    EXPECT_EQ(made.covariance, again.covariance) << i;
    EXPECT_EQ(made.T_world_lidar.t, again.T_world_lidar.t) << i;
  }
}

TEST(MatchCovariance, IsPositiveAndShrinksWithMorePlanes) {
  Stage corner(World::Corner(), 5);
  Stage room(World::Room(), 5);
  const ScanMatcher matcher{ScanMatcherOptions()};
  const MatchResult few = matcher.Match(corner.Scan(SE3()), Predicted(SE3()), corner.map);
  const MatchResult many = matcher.Match(room.Scan(SE3()), Predicted(SE3()), room.map);
  for (const MatchResult* result : {&few, &many}) {
    EXPECT_GT(result->covariance.diagonal().minCoeff(), 0.0);
    EXPECT_LT((result->covariance - result->covariance.transpose()).norm(),
              1e-9 * result->covariance.norm());
  }
  EXPECT_GT(many.matched, few.matched);
  EXPECT_LT(many.covariance.trace(), few.covariance.trace());
}

// Mean squared error of matched poses over their covariance, as a share of 6, in a world with noise
// and with errors along every axis that all points of a 4 m cube have in common.
double NeesPerDof(const World& world, double cube_sigma_m) {
  constexpr int kTrials = 60;
  Stage stage(world, 11);
  const ScanMatcher matcher{ScanMatcherOptions()};
  double sum = 0.0;
  for (int trial = 0; trial < kTrials; ++trial) {
    const SE3 truth = stage.draws.Offset(0.2, 0.6);
    std::map<VoxelKey, Eigen::Vector3d> offsets;
    Points points = world.Sample(2000, 0.005, &stage.draws);
    for (Eigen::Vector3d& p : points) {
      const auto [offset, is_new] =
          offsets.try_emplace(VoxelKeyOf(p, 0.25), Eigen::Vector3d::Zero());
      for (int i = 0; i < 3 && is_new; ++i) {
        offset->second(i) = stage.draws.Normal(cube_sigma_m);
      }
      p += offset->second;
    }
    const MatchResult match =
        matcher.Match(Untimed(ScanFrom(truth, points, stage.map.options().LeafSize())),
                      Predicted(truth), stage.map);
    const Vector6d error = LocalDelta(truth, match.T_world_lidar);
    sum += error.dot(match.covariance.ldlt().solve(error)) / (6.0 * kTrials);
  }
  return sum;
}

TEST(MatchCovariance, ErrorsThatNeighboursHaveInCommonCountOnce) {
  World hall = World::Room();
  for (Facet& facet : hall.facets) {
    for (Eigen::Vector3d* v : {&facet.centre, &facet.edge1, &facet.edge2}) {
      v->head<2>() *= 2.5;
    }
  }
  for (const double cube_sigma_m : {0.0, 0.01}) {
    const double nees = NeesPerDof(hall, cube_sigma_m);
    EXPECT_GT(nees, 0.5) << cube_sigma_m;
    EXPECT_LT(nees, 2.0) << cube_sigma_m;
  }
}

TEST(MatchCovariance, HoldsWhereFewBlocksDetermineThePose) {
  const double nees = NeesPerDof(World::Room(), 0.0);
  EXPECT_GT(nees, 0.5);
  EXPECT_LT(nees, 2.0);
}

World Scaled(World world, double factor) {
  for (Facet& facet : world.facets) {
    for (Eigen::Vector3d* v : {&facet.centre, &facet.edge1, &facet.edge2}) *v *= factor;
  }
  return world;
}

TEST(MatchCovariance, HoldsWhereOneBlockDeterminesThePose) {
  for (const World& small :
       {Scaled(World::Room(), 0.6), Scaled(World::Room(), 0.8), Scaled(World::Corner(), 0.8)}) {
    const double nees = NeesPerDof(small, 0.0);
    EXPECT_GT(nees, 0.5);
    EXPECT_LT(nees, 2.0);
  }
}

}  // namespace
}  // namespace lamina
