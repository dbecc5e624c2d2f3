#include "backend/window/sliding_window.h"

#include <gtest/gtest.h>

#include <map>

#include "backend/bundle/plane_geometry.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

using NodeId = VoxelMap::NodeId;
constexpr StampNs kPeriodNs = 100000000;

VoxelMapOptions UncappedMap() {
  VoxelMapOptions options;
  options.max_fixed_weight = 1e9;
  return options;
}

WindowFrame RandomFrame(std::int64_t id, bool timed, Draws* draws) {
  WindowFrame frame;
  frame.id = id;
  frame.stamp_ns = id * kPeriodNs;
  frame.T_world_lidar = draws->Offset(0.2, 1.0);
  frame.sweep = {draws->Twist(0.2, 2.0), draws->Twist(0.5, 3.0)};
  for (int i = 0; i < 300; ++i) {
    TimedCluster c;
    c.points = ClusterOf(draws->Cloud(draws->Integer(1, 12), draws->InCube(6.0), 0.3));
    if (timed) {
      c.mean_time_s = draws->Uniform(-0.05, 0.05);
      c.time_scatter = c.points.count * 1e-6;
      c.point_time = 1e-4 * draws->InCube(1.0);
    }
    frame.measured.push_back(c);
  }
  return frame;
}

// A frame that sees patches of the world, a cluster each; `first` ones are left out.
WindowFrame FrameOfPatches(std::int64_t id, const std::vector<Patch>& patches, std::size_t first,
                           Draws* draws) {
  WindowFrame frame;
  frame.id = id;
  frame.stamp_ns = id * kPeriodNs;
  frame.T_world_lidar = draws->Offset(0.3, 1.0);
  for (std::size_t i = first; i < patches.size(); ++i) {
    Points seen;
    for (int p = 0; p < 12; ++p) {
      seen.push_back(frame.T_world_lidar.Inverse() * patches[i].Point(0.4, 0.005, draws));
    }
    frame.measured.emplace_back();
    frame.measured.back().points = ClusterOf(seen);
  }
  return frame;
}

// Patches in root voxels of their own.
std::vector<Patch> PatchGrid(const VoxelMapOptions& options, Draws* draws) {
  std::vector<Patch> patches;
  for (int x = -4; x < 4; ++x) {
    for (int y = -4; y < 4; ++y) {
      patches.emplace_back(options.root_size_m * Eigen::Vector3d(x + 0.25, y + 0.25, 0.25),
                           draws->Direction());
    }
  }
  return patches;
}

using Aggregates = std::map<NodeId, PointCluster>;

Aggregates AllAggregates(const SlidingWindow& window, const VoxelMap& map) {
  Aggregates all;
  for (const WindowFrame& frame : window.frames()) {
    for (const NodeId leaf : frame.leaves) all[leaf] = map.Aggregate(leaf);
  }
  return all;
}

double LargestGap(const Aggregates& a, const Aggregates& b) {
  double gap = 0.0;
  for (const auto& [leaf, cluster] : a) {
    const PointCluster& other = b.at(leaf);
    gap = std::max({gap, std::abs(cluster.count - other.count), MeanGap(cluster, other),
                    ScatterGap(cluster, other)});
  }
  return gap;
}

TEST(SlidingWindow, MovingAndMovingBackRestoresTheMap) {
  for (const bool timed : {false, true}) {
    Draws draws(1);
    VoxelMap map(UncappedMap());
    SlidingWindow window(SlidingWindowOptions(), &map);
    for (std::int64_t id = 0; id < 6; ++id) window.Push(RandomFrame(id, timed, &draws));
    const Aggregates before = AllAggregates(window, map);
    ASSERT_GT(before.size(), 300U);
    std::vector<std::pair<SE3, SweepMotion>> states;
    for (std::size_t i = 0; i < 6; ++i) {
      const WindowFrame& frame = window.frames()[i];
      states.emplace_back(frame.T_world_lidar, frame.sweep);
      window.Move(i, frame.T_world_lidar * draws.Offset(0.05, 0.2), draws.Twist(0.2, 2.0));
    }
    EXPECT_GT(LargestGap(before, AllAggregates(window, map)), 0.01);
    for (std::size_t i = 0; i < 6; ++i) window.Move(i, states[i].first, states[i].second);
    EXPECT_LT(LargestGap(before, AllAggregates(window, map)), 1e-9);
  }
}

TEST(SlidingWindow, TheMapHoldsTheSumOfTheFramesInIt) {
  Draws draws(2);
  VoxelMap map(UncappedMap());
  SlidingWindow window(SlidingWindowOptions(), &map);
  for (std::int64_t id = 0; id < 5; ++id) window.Push(RandomFrame(id, true, &draws));
  for (std::size_t i = 0; i < 5; ++i) {
    window.Move(i, window.frames()[i].T_world_lidar * draws.Offset(0.02, 0.1),
                draws.Twist(0.2, 2.0));
  }
  Aggregates sums;
  Aggregates of_first;
  for (const WindowFrame& frame : window.frames()) {
    for (std::size_t k = 0; k < frame.leaves.size(); ++k) {
      const double weight = std::min(frame.measured[k].points.count, 4.0);
      EXPECT_NEAR(frame.in_map[k].count, weight, 1e-12);
      const PointCluster expected = DeskewClusters({frame.measured[k]}, frame.sweep)[0];
      EXPECT_LT(MeanGap(frame.in_map[k], expected.Moved(frame.T_world_lidar)), 1e-3);
      sums[frame.leaves[k]] += frame.in_map[k];
      if (frame.id < 2) of_first[frame.leaves[k]] += frame.in_map[k];
    }
  }
  EXPECT_LT(LargestGap(sums, AllAggregates(window, map)), 1e-9);
  // What leaves the window becomes fixed as it stood; the sum stays.
  FinalKeyframe left, next;
  window.PopOldest(&left);
  EXPECT_EQ(window.frames().front().id, 1);
  window.PopOldest(&next);
  EXPECT_EQ(window.frames().size(), 3U);
  Aggregates fixed, all;
  for (const auto& [leaf, cluster] : of_first) fixed[leaf] = map.FixedAggregate(leaf);
  // Who asks is told just that.
  EXPECT_EQ(left.id, 0);
  left.clusters.insert(left.clusters.end(), next.clusters.begin(), next.clusters.end());
  PointCluster told, became;
  for (const PointCluster& cluster : left.clusters) told += cluster;
  for (const auto& [leaf, cluster] : fixed) became += cluster;
  EXPECT_NEAR(told.count, became.count, 1e-6 * told.count);
  EXPECT_LT(MeanGap(told, became), 1e-6);
  for (const auto& [leaf, cluster] : sums) all[leaf] = map.Aggregate(leaf);
  // To single precision, in which fixed clusters are kept.
  EXPECT_LT(LargestGap(of_first, fixed), 1e-6);
  EXPECT_LT(LargestGap(sums, all), 1e-6);
}

TEST(SlidingWindow, ProblemNamesFramesInOrderWithCappedWeights) {
  Draws draws(3);
  VoxelMap map(UncappedMap());
  SlidingWindowOptions options;
  SlidingWindow window(options, &map);
  const std::vector<Patch> patches = PatchGrid(map.options(), &draws);
  // Frame k sees all patches but the first k: those that one frame alone sees must not come up.
  for (std::size_t k = 0; k < 5; ++k) {
    window.Push(FrameOfPatches(static_cast<std::int64_t>(k), patches, k, &draws));
  }
  map.Refresh();
  const BundleProblem problem = window.BuildProblem();
  EXPECT_TRUE(problem.hold_first_pose);
  ASSERT_EQ(problem.poses.size(), 5U);
  EXPECT_EQ(problem.poses[3].t, window.frames()[3].T_world_lidar.t);
  EXPECT_GE(problem.priors.size(), 4U);
  EXPECT_GT(problem.planes.size(), 50U);
  EXPECT_LT(problem.planes.size(), patches.size());
  for (const Plane& plane : problem.planes) {
    EXPECT_GE(plane.count, 2);
    EXPECT_TRUE(plane.fixed.Empty());
    EXPECT_GT(plane.weight, 0.0);
    EXPECT_LE(plane.weight, 1.0 / (map.options().noise_floor_m * map.options().noise_floor_m));
    int last = -1;
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const PlaneObservation& o = problem.observations.at(static_cast<std::size_t>(i));
      EXPECT_GT(o.frame, last);
      EXPECT_LT(o.frame, 5);
      EXPECT_LE(o.cluster.count, map.options().max_cluster_weight + 1e-9);
      EXPECT_GT(o.cluster.count, 0.9 * map.options().max_cluster_weight);
      last = o.frame;
    }
  }
}

TEST(SlidingWindow, ProblemKeepsWhatHasLeftAsFixedClusters) {
  Draws draws(4);
  VoxelMap map(UncappedMap());
  SlidingWindow window(SlidingWindowOptions(), &map);
  const std::vector<Patch> patches = PatchGrid(map.options(), &draws);
  for (std::int64_t k = 0; k < 5; ++k) window.Push(FrameOfPatches(k, patches, 0, &draws));
  window.PopOldest();
  window.PopOldest();
  map.Refresh();
  const BundleProblem problem = window.BuildProblem();
  EXPECT_FALSE(problem.hold_first_pose);
  EXPECT_EQ(problem.poses.size(), 3U);
  ASSERT_GT(problem.planes.size(), 50U);
  for (const Plane& plane : problem.planes) {
    EXPECT_EQ(plane.count, 3);
    EXPECT_NEAR(plane.fixed.count, 8.0, 1e-9);
  }
}

TEST(SlidingWindow, WhatStoodBeforeAWallDoesNotMoveItsAnchor) {
  for (const int stay : {2, 4, 6}) {
    Draws draws(13);
    const VoxelMapOptions map_options;
    VoxelMap map(map_options);
    SlidingWindow window(SlidingWindowOptions(), &map);
    // Walls in other voxels say what thickness is usual.
    std::vector<Patch> patches = PatchGrid(map_options, &draws);
    const Eigen::Vector3d place = map_options.root_size_m * Eigen::Vector3d(6.25, 6.25, 6.25);
    const Patch wall(place, Eigen::Vector3d::UnitX());
    patches.push_back(wall);
    // In the same leaf, 0.3 m before the wall.
    const Patch visitor(place - 0.3 * wall.Normal(), Eigen::Vector3d::UnitX());
    NodeId leaf = VoxelMap::kNoNode;
    for (int k = 0; k < 40; ++k) {
      const bool visited = k >= 18 && k < 18 + stay;
      std::vector<Patch> seen = patches;
      if (visited) seen.push_back(visitor);
      if (window.full()) window.PopOldest();
      window.Push(FrameOfPatches(k, seen, 0, &draws));
      map.Refresh();
      if (k % 5 == 4) window.BuildProblem();
      leaf = window.frames().back().leaves[patches.size() - 1];
    }
    const PointCluster fixed = map.FixedAggregate(leaf);
    EXPECT_GT(fixed.count, 5.0);
    EXPECT_LT(std::abs(wall.Normal().dot(fixed.mean - wall.centre)), 0.005) << stay << " frames";
    EXPECT_LT(std::sqrt(fixed.EigenPairs().l(2)), 0.02) << stay << " frames";
  }
}

TEST(SlidingWindow, PlanesMuchThickerThanTheOthersWeighFarLess) {
  Draws draws(6);
  VoxelMap map(UncappedMap());
  const SlidingWindowOptions options;
  SlidingWindow window(options, &map);
  const std::vector<Patch> patches = PatchGrid(map.options(), &draws);
  const std::size_t thick = patches.size() / 10;
  for (std::int64_t k = 0; k < 5; ++k) {
    WindowFrame frame = FrameOfPatches(k, patches, 0, &draws);
    // Two sheets, 12 cm apart, seen by turns.
    for (std::size_t i = 0; i < thick; ++i) {
      const Eigen::Vector3d normal = frame.T_world_lidar.q.conjugate() * patches[i].Normal();
      frame.measured[i].points.mean += (k % 2 == 0 ? 0.06 : -0.06) * normal;
    }
    window.Push(std::move(frame));
  }
  map.Refresh();
  const BundleProblem problem = window.BuildProblem();
  const double floor2 = map.options().noise_floor_m * map.options().noise_floor_m;
  std::size_t distrusted = 0;
  for (const Plane& plane : problem.planes) {
    const double variance =
        AggregatePlane(problem, plane, problem.poses).EigenPairs().l(2) + floor2;
    if (variance < 2.0 * floor2) {
      EXPECT_NEAR(plane.weight * variance, 1.0, 0.1);
    } else {
      EXPECT_LT(plane.weight * variance, 0.1);
      ++distrusted;
    }
  }
  EXPECT_GT(distrusted, 0U);
  EXPECT_LE(distrusted, thick);
}

TEST(SlidingWindow, FarAwayClustersAreLeftOut) {
  Draws draws(5);
  VoxelMap map(UncappedMap());
  SlidingWindow window(SlidingWindowOptions(), &map);
  WindowFrame frame = RandomFrame(0, false, &draws);
  frame.measured[3].points.mean.x() = 1e8;
  window.Push(frame);
  EXPECT_EQ(window.frames()[0].leaves[3], VoxelMap::kNoNode);
  window.Move(0, draws.Offset(0.1, 1.0), SweepMotion());
  map.Refresh();
  EXPECT_TRUE(window.BuildProblem().poses.size() == 1U);
  window.PopOldest();
}

// Number k of frames that accelerate along x, by 0.2 m from one step to the next.
WindowFrame Accelerating(std::int64_t k, StampNs stamp_ns) {
  WindowFrame frame;
  frame.id = k;
  frame.stamp_ns = stamp_ns;
  frame.T_world_lidar.t.x() = 0.1 * static_cast<double>(k * k);
  return frame;
}

TEST(SlidingWindow, MotionIsThatThroughTheFramesBeforeAndAfter) {
  VoxelMap map(UncappedMap());
  SlidingWindow window(SlidingWindowOptions(), &map);
  for (std::int64_t k = 0; k < 4; ++k)
    window.Push(Accelerating(k, k < 3 ? k * kPeriodNs : 20 * kPeriodNs));
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_NEAR(window.MotionAt(k).twist(3), 2.0 * static_cast<double>(k), 1e-9);
    EXPECT_NEAR(window.MotionAt(k).acceleration(3), 20.0, 1e-9);
  }
  // The gap after it says nothing.
  EXPECT_NEAR(window.MotionAt(2).twist(3), 3.0, 1e-9);
  EXPECT_EQ(window.MotionAt(3).twist.norm(), 0.0);
  StampedPose next{21 * kPeriodNs, window.frames()[3].T_world_lidar};
  next.T_world_lidar.t.x() += 0.4;
  EXPECT_NEAR(window.MotionAt(3, &next).twist(3), 4.0, 1e-9);
}

TEST(SlidingWindow, FramesThatHaveLeftTellTheMotionDuringTheOldest) {
  VoxelMap map(UncappedMap());
  SlidingWindow window(SlidingWindowOptions(), &map);
  for (std::int64_t k = 0; k < 12; ++k) window.Push(Accelerating(k, k * kPeriodNs));
  for (int k = 0; k < 9; ++k) window.PopOldest();
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_NEAR(window.MotionAt(k).twist(3), 2.0 * static_cast<double>(9 + k), 1e-9);
    EXPECT_NEAR(window.MotionAt(k).acceleration(3), 20.0, 1e-9);
  }
}

SE3 Along(double x) { return SE3(Eigen::Quaterniond::Identity(), {x, 0.0, 0.0}); }

// A window of four frames a metre apart, the match of the third least sure along x, by 1 cm.
class WindowAstrayTest : public ::testing::Test {
 protected:
  WindowAstrayTest() : window_({}, &map_) {
    Draws draws(5);
    Matrix6d covariance = 1e-8 * Matrix6d::Identity();
    covariance(3, 3) = 1e-4;
    for (std::int64_t id = 0; id < 4; ++id) {
      WindowFrame frame = RandomFrame(id, false, &draws);
      frame.T_world_lidar = Along(static_cast<double>(id));
      frame.T_previous_this = Along(1.0);
      if (id == 2) frame.SetWeakest(covariance, Along(2.03));
      window_.Push(std::move(frame));
    }
  }
  // Whether it is astray where a solution moves the third frame by so much.
  bool Astray(const Eigen::Vector3d& by) {
    std::vector<SE3> poses;
    for (const WindowFrame& frame : window_.frames()) poses.push_back(frame.T_world_lidar);
    poses[2].t += by;
    return window_.HoldAstray({0, 1, 2, 3}, poses);
  }

  VoxelMap map_{UncappedMap()};
  SlidingWindow window_;
};

TEST_F(WindowAstrayTest, WhatTheMatchLeavesOpenIsForBundleAdjustmentToFind) {
  EXPECT_FALSE(Astray({0.045, 0.0, 0.0}));  // beyond three standard deviations
  EXPECT_FALSE(Astray({0.0, 0.2, 0.0}));    // not where the match is least sure
  EXPECT_FALSE(Astray({0.01, 0.0, 0.03}));
  EXPECT_EQ(window_.frames()[2].held_information(0), 0.0);
}

TEST_F(WindowAstrayTest, AFrameThatIsLedAstrayIsHeldToTheFrontendsMotion) {
  EXPECT_TRUE(Astray({-0.08, 0.0, 0.0}));
  const WindowFrame& held = window_.frames()[2];
  EXPECT_NEAR(std::abs(held.held(3, 0)), 1.0, 1e-6);
  EXPECT_GT(held.held_information(0), 1e5);
  // Its neighbours, which are where they were, are not.
  EXPECT_EQ(window_.frames()[1].held_information(0), 0.0);
  EXPECT_EQ(window_.frames()[3].held_information(0), 0.0);
  // A solution that still does so is the best that there is.
  EXPECT_FALSE(Astray({-0.08, 0.0, 0.0}));
}

TEST_F(WindowAstrayTest, WhereAMatchDoesNotSayHowSureItIsNothingIsAstray) {
  EXPECT_FALSE(window_.HoldAstray({0, 1}, {SE3(), Along(5.0)}));
}

}  // namespace
}  // namespace lamina
