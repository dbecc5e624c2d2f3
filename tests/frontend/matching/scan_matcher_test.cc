#include "frontend/matching/scan_matcher.h"
#include "core/base/angle.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "tests/frontend/matching/scan_matcher_fixture.h"
#include "tests/support/scenes/bay_street.h"

namespace lamina {
namespace {

using MatchStatus = MatchResult::Status;

World CorridorWithPoles() {
  Draws draws(99);
  World world = World::Corridor();
  world.AddPoles(&draws);
  return world;
}

SE3 Shifted(const SE3& T, const SE3& by) { return SE3(T.q * by.q, T.t + by.t); }

// A corridor with boards across it, a few points each, and before them a wall of thousands.
TEST(ScanMatcher, BlocksSayWhereTheSensorIsWhenWhatIsDenseHasMoved) {
  Stage stage(World::Corridor(), 5);
  World boards = World::Corridor(), wall;
  for (int i = 0; i < 16; ++i) {
    boards.facets.push_back(
        {{4.0 * i - 26.0, i % 2 == 0 ? 1.4 : -1.2, 0.2}, {0, 0.5, 0}, {0, 0, 1}});
  }
  wall.facets.push_back({{9.0, 0, 0}, {0, 6, 0}, {0, 0, 5}});
  World all = boards;
  all.facets.push_back(wall.facets.front());
  FillMap(all, 5, 3000, 0.005, &stage.draws, &stage.map);
  const ScanMatcher matcher{ScanMatcherOptions()};
  for (const double moved_m : {0.0, 0.06}) {
    Points points = boards.Sample(60, 0.005, &stage.draws);
    for (const Eigen::Vector3d& p : wall.Sample(5000, 0.005, &stage.draws)) {
      points.push_back(p + moved_m * Eigen::Vector3d::UnitX());
    }
    const std::vector<PointCluster> scan =
        Untimed(ScanFrom(SE3(), points, stage.map.options().LeafSize()));
    const MatchResult result = matcher.Match(scan, Predicted(SE3()), stage.map);
    const Eigen::Vector3d by_blocks = result.T_world_lidar.t + result.block_step.step_m;
    EXPECT_NEAR(result.T_world_lidar.t.x(), -moved_m, 0.03);
    EXPECT_LT(std::abs(by_blocks.x()), 0.5 * moved_m + 0.01) << result.block_step.sigmas;
    EXPECT_EQ(result.block_step.sigmas > 2.5, moved_m > 0.0) << result.block_step.sigmas;
  }
}

TEST(ScanMatcher, RecoversThePoseInACornerOfThreePlanes) {
  Stage stage(World::Corner(), 1);
  const ScanMatcher matcher{ScanMatcherOptions()};
  for (int i = 0; i < 20; ++i) {
    const SE3 truth = stage.draws.Offset(0.2, 0.6);
    const SE3 start = Shifted(truth, stage.draws.Offset(2.0 * kDegree, 0.2));
    const MatchResult result = matcher.Match(stage.Scan(truth), Predicted(start), stage.map);
    EXPECT_NE(result.status, MatchStatus::kTooFewMatches);
    EXPECT_EQ(result.degenerate, 0);
    EXPECT_LT(RotationAngle(result.T_world_lidar, truth), 0.1 * kDegree);
    EXPECT_LT((result.T_world_lidar.t - truth.t).norm(), 0.01);
    EXPECT_GT(result.inlier_share, 0.6);
    EXPECT_LT(result.residual_rms_m, 0.03);
  }
}

// Points of foliage along straight strokes of a scan pattern: each in the sheet that its stroke
// sweeps, at any depth. In the LiDAR frame.
Points StrokesThroughFoliage(int strokes, int per_stroke, Draws* draws) {
  Draws pattern(5);  // which is the same in every scan
  Points points;
  for (int i = 0; i < strokes; ++i) {
    const Eigen::Vector3d from = pattern.Direction(), to = pattern.Direction();
    for (int k = 0; k < per_stroke; ++k) {
      const Eigen::Vector3d along = from + draws->Uniform(0.0, 1.0) * (to - from);
      points.push_back(
          draws->Uniform(2.0, 4.5) * along.normalized() +
          Eigen::Vector3d(draws->Normal(0.005), draws->Normal(0.005), draws->Normal(0.005)));
    }
  }
  return points;
}

TEST(ScanMatcher, SheetsOfABeamThatMoveAlongWithTheSensorDoNotHoldIt) {
  // A sensor stood for ten scans between three walls and foliage, and moves on by 0.3 m: the sheets
  // say that it still stands, with ten times the points of the walls.
  constexpr int kStrokes = 40, kPerStroke = 400;
  Stage stage(World::Corner(), 7);
  for (std::int64_t frame = 5; frame < 15; ++frame) {
    const Points sheets = StrokesThroughFoliage(kStrokes, kPerStroke, &stage.draws);
    for (const PointCluster& c : Untimed(ScanFrom(SE3(), sheets, stage.map.options().LeafSize())))
      stage.map.AddWindow(stage.map.LeafAt(c.mean), c, frame);
  }
  stage.map.Refresh();
  const ScanMatcher matcher{ScanMatcherOptions()};
  for (const Eigen::Vector3d& way : {Eigen::Vector3d(0.3, 0.0, 0.0), Eigen::Vector3d(0.0, 0.3, 0.0),
                                     Eigen::Vector3d(-0.2, -0.2, 0.1)}) {
    const SE3 truth(Eigen::Quaterniond::Identity(), way);
    Points seen = stage.world.Sample(500, 0.005, &stage.draws);
    for (const Eigen::Vector3d& p : StrokesThroughFoliage(kStrokes, kPerStroke, &stage.draws))
      seen.push_back(truth * p);
    const double leaf_m = stage.map.options().LeafSize();
    const MatchResult result =
        matcher.Match(Untimed(ScanFrom(truth, seen, leaf_m)), Predicted(SE3()), stage.map);
    EXPECT_LT((result.T_world_lidar.t - truth.t).norm(), 0.03) << way.transpose();
    // Nor does where it stood look better.
    EXPECT_GT(matcher.Compare(Untimed(ScanFrom(truth, seen, leaf_m)), truth, SE3(), stage.map, 0.1)
                  .evidence_sigmas,
              0.0);
  }
}

// In grass and among leaves the sheets of the scan before are about this one, where it is in its
// right place, and elsewhere it meets nothing.
TEST(ScanMatcher, SheetsOfABeamDoNotSpeakAgainstThePlaceWhereTheyAreMet) {
  constexpr int kStrokes = 40, kPerStroke = 400;
  Draws draws(7);
  const World world = World::Corner();
  const auto seen_from = [&](const SE3& T) {
    Points seen = world.Sample(500, 0.005, &draws);
    for (const Eigen::Vector3d& p : StrokesThroughFoliage(kStrokes, kPerStroke, &draws))
      seen.push_back(T * p);
    return seen;
  };
  VoxelMap map{VoxelMapOptions()};
  const double leaf_m = map.options().LeafSize();
  for (const PointCluster& c : Untimed(ScanFrom(SE3(), seen_from(SE3()), leaf_m)))
    map.AddWindow(map.LeafAt(c.mean), c, 0);
  map.Refresh();
  const SE3 truth(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.1, 0.0, 0.0));
  const SE3 aside(Eigen::Quaterniond::Identity(), Eigen::Vector3d(-6.0, -6.0, 0.0));
  const std::vector<PointCluster> scan = Untimed(ScanFrom(truth, seen_from(truth), leaf_m));
  const ScanMatcher matcher{ScanMatcherOptions()};
  const FitDifference better = matcher.Compare(scan, truth, aside, map, 0.3);
  EXPECT_GT(better.votes_sigmas, 3.0);
  EXPECT_GT(better.evidence_sigmas, 3.0);
  // As to a search, which ranks minima by what they have beyond chance.
  const double chance = MatchResult::kChanceFit;
  EXPECT_GT(matcher.Score(scan, truth, map, 0.2, 1, chance),
            matcher.Score(scan, aside, map, 0.2, 1, chance));
}

// Of a sensor that has gone on by 4 m the map has half of the ground, and all of what faces the
// way. Where it stood before the map has all of the ground.
TEST(ScanMatcher, GroundBeyondTheMapHasNoVoteForWhereTheSensorWas) {
  constexpr double kWayM = 4.0;
  Draws draws(3);
  const auto seen_from = [&](double x) {
    Points points;
    for (int i = 0; i < 6000; ++i) {
      points.emplace_back(x + draws.Uniform(-4.0, 4.0), draws.Uniform(-4.0, 4.0),
                          -1.5 + draws.Normal(0.01));
    }
    for (int i = 0; i < 400; ++i) {
      points.emplace_back(6.0 + draws.Normal(0.01), draws.Uniform(-6.0, 6.0),
                          draws.Uniform(-1.0, 1.0));
    }
    return points;
  };
  VoxelMap map{VoxelMapOptions()};
  const double leaf_m = map.options().LeafSize();
  for (const PointCluster& c : Untimed(ScanFrom(SE3(), seen_from(0.0), leaf_m)))
    map.AddWindow(map.LeafAt(c.mean), c, 0);
  map.Refresh();
  const SE3 truth(Eigen::Quaterniond::Identity(), Eigen::Vector3d(kWayM, 0.0, 0.0));
  const std::vector<PointCluster> scan = Untimed(ScanFrom(truth, seen_from(kWayM), leaf_m));
  const ScanMatcher matcher{ScanMatcherOptions()};
  const double sigmas = matcher.CompareBlocks(scan, truth, SE3(), map, 0.3);
  EXPECT_GT(sigmas, 1.0);
  EXPECT_NEAR(matcher.CompareBlocks(scan, SE3(), truth, map, 0.3), -sigmas, 1e-9);
}

TEST(ScanMatcher, ACorridorLeavesItsAxisToThePrediction) {
  Stage stage(World::Corridor(), 2);
  const ScanMatcher matcher{ScanMatcherOptions()};
  for (int i = 0; i < 10; ++i) {
    const SE3 truth = stage.draws.Offset(0.05, 0.3);
    const SE3 start =
        Shifted(truth, SE3(ExpSO3(0.5 * kDegree * stage.draws.Direction()), {0.3, 0.1, -0.05}));
    const MatchResult result = matcher.Match(stage.Scan(truth), Predicted(start), stage.map);
    EXPECT_NE(result.status, MatchStatus::kTooFewMatches);
    ASSERT_EQ(result.degenerate, 1);
    EXPECT_GT(std::abs(result.degenerate_directions(3, 0)), 0.99);
    EXPECT_GT(result.worst_sigma_m, ScanMatcherOptions().max_direction_sigma_m);
    EXPECT_NEAR(result.T_world_lidar.t.x(), start.t.x(), 0.01);
    EXPECT_LT((result.T_world_lidar.t - truth.t).tail<2>().norm(), 0.01);
    EXPECT_LT(RotationAngle(result.T_world_lidar, truth), 0.1 * kDegree);
    // The covariance says so: far larger along the axis than across.
    EXPECT_GT(result.covariance(3, 3), 100.0 * result.covariance(4, 4));
  }
}

TEST(ScanMatcher, PolesMakeTheAxisOfTheCorridorObservable) {
  Stage stage(CorridorWithPoles(), 3);
  const ScanMatcher matcher{ScanMatcherOptions()};
  for (int i = 0; i < 5; ++i) {
    const SE3 truth = stage.draws.Offset(0.05, 0.3);
    const SE3 start = Shifted(truth, SE3(Eigen::Quaterniond::Identity(), {0.15, 0.02, 0.0}));
    const MatchResult result = matcher.Match(stage.Scan(truth), Predicted(start), stage.map);
    EXPECT_EQ(result.degenerate, 0);
    EXPECT_NEAR(result.T_world_lidar.t.x(), truth.t.x(), 0.05);
  }
}

TEST(ScanMatcher, PlanesInPlaceOfTheMapsSayWhatTheyWeigh) {
  Stage stage(World::Corner(), 12);
  const SE3 pose = stage.draws.Offset(0.2, 0.6);
  const std::vector<PointCluster> scan = stage.Scan(pose);
  const ScanMatcher matcher{ScanMatcherOptions()};
  const auto information = [&](const PlanesInstead& planes) {
    return matcher.EvidenceOf(planes, scan, pose, stage.map, Matrix6d::Identity()).information;
  };
  const auto as_mapped = [&](double weight) {
    return information([&, weight](VoxelMap::NodeId id) {
      const bool plane = stage.map.kind(id) == Surface::Kind::kPlane;
      return plane ? WeightedPlane{&stage.map.plane(id), weight} : WeightedPlane();
    });
  };
  const Vector6d all = as_mapped(1.0);
  EXPECT_GT(all.minCoeff(), 0.0);
  EXPECT_LT((as_mapped(0.25) - 0.25 * all).norm(), 1e-9 * all.norm());
  EXPECT_TRUE(information([](VoxelMap::NodeId) { return WeightedPlane(); }).isZero());
  // Half a metre beside the scan they say nothing.
  std::map<VoxelMap::NodeId, Surface> beside;
  const Vector6d other = information([&](VoxelMap::NodeId id) {
    if (stage.map.kind(id) != Surface::Kind::kPlane) return WeightedPlane();
    Surface& plane = beside[id] = stage.map.plane(id);
    plane.mean += 0.5 * plane.normal.cast<double>();
    return WeightedPlane{&plane, 1.0};
  });
  EXPECT_LT(other.maxCoeff(), 0.01 * all.minCoeff());
}

TEST(ScanMatcher, TooFewMatchesLeaveThePoseAsItWas) {
  Stage stage(World::Corner(), 4);
  const ScanMatcher matcher{ScanMatcherOptions()};
  const SE3 start = stage.draws.Pose(1.0);
  const VoxelMap empty{VoxelMapOptions()};
  const auto expect_refused = [&](const MatchResult& result) {
    EXPECT_EQ(result.status, MatchStatus::kTooFewMatches);
    EXPECT_EQ(result.T_world_lidar.t, start.t);
    EXPECT_EQ(result.T_world_lidar.q.coeffs(), start.q.coeffs());
  };
  expect_refused(matcher.Match(stage.Scan(start), Predicted(start), empty));
  expect_refused(matcher.Match({}, Predicted(start), stage.map));
  std::vector<PointCluster> few = stage.Scan(start);
  few.resize(5);
  expect_refused(matcher.Match(few, Predicted(start), stage.map));
}

TEST(ScanMatcher, ARefusedScanCarriesNoDegeneracy) {
  // Matches at the start leave directions open; the first step then carries the scan off the small
  // plane, to where too few are left.
  World world;
  world.facets.push_back({{5.5, 0, 0.8}, {0, 4, 0}, {0, 0, 0.7}});
  world.facets.push_back({{2.4, 2.4, 0.8}, {0.7, 0, 0}, {0, 0, 0.7}});
  Stage stage(world, 8);
  constexpr double kOffM = 0.6;
  std::vector<PointCluster> scan;
  for (int i = 0; i < 9; ++i) {
    const Patch wall({5.5 - kOffM, 0.8 * (i - 4), 0.7}, Eigen::Vector3d::UnitX());
    scan.push_back(ClusterOf({wall.centre, wall.centre + 0.1 * wall.u1, wall.centre - 0.1 * wall.u1,
                              wall.centre + 0.1 * wall.u2, wall.centre - 0.1 * wall.u2}));
  }
  for (int i = 0; i < 3; ++i) scan.push_back(ClusterOf({{3.0, 2.4, 0.5 + 0.2 * i}}));
  ScanMatcherOptions options;
  options.max_iterations = 1;
  EXPECT_GT(ScanMatcher(options).Score(scan, SE3(), stage.map, 1.0), 0.5);  // met at the start
  for (const int iterations : {1, 20}) {
    options.max_iterations = iterations;
    const MatchResult result = ScanMatcher(options).Match(scan, Predicted(SE3()), stage.map);
    EXPECT_EQ(result.status, MatchStatus::kTooFewMatches);
    EXPECT_EQ(result.T_world_lidar.t, Eigen::Vector3d::Zero());
    EXPECT_EQ(result.degenerate, 0);
    EXPECT_TRUE(result.degenerate_directions.isZero());
    EXPECT_TRUE(result.covariance.isZero());
    EXPECT_EQ(result.worst_sigma_m, 0.0);
  }
}

TEST(ScanMatcher, HasTheSameBitsAtAnyNumberOfThreads) {
  Stage stage(World::Room(), 6);
  const ScanMatcher matcher{ScanMatcherOptions()};
  const std::vector<PointCluster> scan = stage.Scan(SE3());
  const SE3 start = stage.draws.Offset(0.02, 0.1);
  SE3 first;
  for (const std::size_t threads : {1U, 2U, 4U}) {
    const ThreadLimit limit(threads);
    const SE3 T = matcher.Match(scan, Predicted(start), stage.map).T_world_lidar;
    if (threads == 1) first = T;
    EXPECT_EQ(T.t, first.t) << threads << " threads";
    EXPECT_EQ(T.q.coeffs(), first.q.coeffs()) << threads << " threads";
  }
}

TEST(ScanMatcher, AStartFarAlongAWeakDirectionIsNotKeptWithoutAWord) {
  // Little in a street faces along it, and what does is beyond the reach of its planes at first.
  const BayStreet street(11);
  Draws draws(12);
  VoxelMap map{VoxelMapOptions()};
  for (std::int64_t frame = 0; frame < 8; ++frame) {
    const SE3 T = BayStreet::PoseAt(1.0 * static_cast<double>(frame));
    const auto clusters = BuildScanClusters(street.Scan(T, 8000, &draws), map.options().LeafSize());
    for (const PointCluster& c : Untimed(clusters)) {
      const PointCluster in_world = c.Moved(T);
      map.AddWindow(map.LeafAt(in_world.mean), in_world, frame);
    }
  }
  map.Refresh();
  const ScanMatcher matcher{ScanMatcherOptions()};
  int right = 0;
  for (int i = 0; i < 40; ++i) {
    const SE3 truth = BayStreet::PoseAt(draws.Uniform(2.0, 8.0));
    const auto scan =
        Untimed(BuildScanClusters(street.Scan(truth, 8000, &draws), map.options().LeafSize()));
    const double off = draws.Uniform(0.84, 1.16) * (i % 2 == 0 ? 1.0 : -1.0);
    PosePrediction prediction;
    prediction.T_world_lidar = SE3(truth.q, truth.t + Eigen::Vector3d(off, 0.0, 0.0));
    prediction.covariance.diagonal().setConstant(1.0);
    const MatchResult result = matcher.Match(scan, prediction, map);
    const double error = (result.T_world_lidar.t - truth.t).norm();
    right += error < 0.05 ? 1 : 0;
    // Held at the prediction, and not said to be.
    EXPECT_TRUE(result.degenerate > 0 || error < std::abs(off) - 0.1) << "start " << i;
  }
  EXPECT_GE(right, 34);
}

TEST(ScanMatcher, ScoreIsHighestAtTheTruth) {
  Stage stage(World::Room(), 7);
  const ScanMatcher matcher{ScanMatcherOptions()};
  const std::vector<PointCluster> scan = stage.Scan(SE3());
  const double best = matcher.Score(scan, SE3(), stage.map, 0.2);
  EXPECT_GT(best, 0.6);
  EXPECT_LE(best, 1.0);
  for (int i = 0; i < 20; ++i) {
    EXPECT_LT(matcher.Score(scan, stage.draws.Offset(0.15, 0.3), stage.map, 0.2), best - 0.05);
  }
  EXPECT_NEAR(matcher.Score(scan, SE3(), stage.map, 0.2, 3), best, 0.1);
  EXPECT_EQ(matcher.Score(scan, SE3(), VoxelMap{VoxelMapOptions()}, 0.2), 0.0);
  EXPECT_EQ(matcher.Score({}, SE3(), stage.map, 0.2), 0.0);
}

}  // namespace
}  // namespace lamina
