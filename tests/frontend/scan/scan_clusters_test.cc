#include "frontend/scan/scan_clusters.h"

#include <gtest/gtest.h>

#include <map>
#include <tuple>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

std::vector<TimedPoint> RandomPoints(int count, Draws* draws) {
  std::vector<TimedPoint> points;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d p = draws->InCube(i % 2 == 0 ? 3.0 : 80.0);
    points.push_back({static_cast<float>(p.x()), static_cast<float>(p.y()),
                      static_cast<float>(p.z()), static_cast<float>(draws->Uniform(-0.05, 0.05))});
  }
  return points;
}

TEST(ScanClusters, EqualGatheringThePointsOfEachVoxelByHand) {
  Draws draws(1);
  for (int run = 0; run < 20; ++run) {
    const double leaf = draws.Uniform(0.3, 2.0);
    const std::vector<TimedPoint> points = RandomPoints(2000, &draws);
    std::map<std::tuple<int, int, int>, std::vector<TimedPoint>> voxels;
    std::vector<std::tuple<int, int, int>> order;
    for (const TimedPoint& p : points) {
      const auto cell = [&](float x) {
        return static_cast<int>(std::floor(static_cast<double>(x) * (1.0 / leaf)));
      };
      const auto key = std::make_tuple(cell(p.x), cell(p.y), cell(p.z));
      if (voxels[key].empty()) order.push_back(key);
      voxels[key].push_back(p);
    }
    const std::vector<TimedCluster> clusters = BuildScanClusters(points, leaf);
    ASSERT_EQ(clusters.size(), order.size());
    for (std::size_t i = 0; i < order.size(); ++i) {
      const std::vector<TimedPoint>& members = voxels[order[i]];
      Points positions;
      double mean_time = 0.0, time_scatter = 0.0;
      for (const TimedPoint& p : members) {
        positions.emplace_back(p.x, p.y, p.z);
        mean_time += p.time_s / static_cast<double>(members.size());
      }
      const PointCluster expected = ClusterOf(positions);
      Eigen::Vector3d point_time = Eigen::Vector3d::Zero();
      for (std::size_t k = 0; k < members.size(); ++k) {
        const double s = members[k].time_s - mean_time;
        time_scatter += s * s;
        point_time += s * (positions[k] - expected.mean);
      }
      EXPECT_EQ(clusters[i].points.count, expected.count);
      EXPECT_LT(MeanGap(clusters[i].points, expected), 1e-10);
      EXPECT_LT(ScatterGap(clusters[i].points, expected), 1e-9);
      EXPECT_NEAR(clusters[i].mean_time_s, mean_time, 1e-12);
      EXPECT_NEAR(clusters[i].time_scatter, time_scatter, 1e-12);
      EXPECT_LT((clusters[i].point_time - point_time).norm(), 1e-10);
    }
  }
}

TEST(ScanClusters, DeskewingThemAllMeetsDeskewingEach) {
  Draws draws(2);
  // Times as of a sweep: they follow the azimuth, so that a voxel is seen within an instant.
  std::vector<TimedPoint> points = RandomPoints(20000, &draws);
  for (TimedPoint& p : points) p.time_s = 0.1F * std::atan2(p.y, p.x) / 6.2832F;
  const std::vector<TimedCluster> clusters = BuildScanClusters(points, 0.8);
  const Vector6d twist = draws.Twist(0.5, 15.0);
  const std::vector<PointCluster> all = DeskewClusters(clusters, twist);
  ASSERT_EQ(all.size(), clusters.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    // Around its own time.
    const PointCluster one = DeskewClusters({clusters[i]}, twist)[0];
    EXPECT_EQ(all[i].count, one.count);
    EXPECT_LT(MeanGap(all[i], one), 1e-6);
    EXPECT_LT(ScatterGap(all[i], one), 5e-5 * one.count);
  }
  EXPECT_TRUE(AnyTimed(clusters));
  for (TimedPoint& p : points) p.time_s = 0.0F;
  const std::vector<TimedCluster> still = BuildScanClusters(points, 0.8);
  EXPECT_FALSE(AnyTimed(still));
  EXPECT_EQ(MeanGap(DeskewClusters(still, twist)[7], still[7].points), 0.0);
}

// Points of a sweep by a sensor that turns and moves faster and faster, of things at rest.
TEST(ScanClusters, AreDeskewedUnderAMotionThatIsNotSteady) {
  Draws draws(4);
  const SweepMotion motion(draws.Twist(0.5, 3.0), draws.Twist(5.0, 8.0));
  std::vector<TimedPoint> points = RandomPoints(20000, &draws);
  for (TimedPoint& p : points) p.time_s = 0.1F * std::atan2(p.y, p.x) / 6.2832F;
  const std::vector<std::vector<TimedPoint>> groups = GroupByCluster(points, 0.8);
  const std::vector<PointCluster> all = DeskewClusters(BuildScanClusters(points, 0.8), motion);
  const std::vector<PointCluster> steady =
      DeskewClusters(BuildScanClusters(points, 0.8), motion.twist);
  double worst_m = 0.0, steady_m = 0.0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const TimedPoint& p : groups[i]) {
      mean += motion.PoseAt(p.time_s) * Eigen::Vector3d(p.x, p.y, p.z) /
              static_cast<double>(groups[i].size());
    }
    worst_m = std::max(worst_m, (all[i].mean - mean).norm());
    steady_m = std::max(steady_m, (steady[i].mean - mean).norm());
  }
  EXPECT_LT(worst_m, 2e-3);
  EXPECT_GT(steady_m, 0.02);
}

TEST(ScanClusters, TimesCountFromTheMiddleOfTheSweep) {
  Draws draws(5);
  std::vector<TimedPoint> points = RandomPoints(4000, &draws);
  for (TimedPoint& p : points) p.time_s = 0.1F * static_cast<float>(draws.Uniform(0.0, 1.0));
  std::vector<TimedCluster> clusters = BuildScanClusters(points, 0.8);
  const std::vector<TimedCluster> before = clusters;
  const StampNs middle_ns = CentreTimes(&clusters);
  EXPECT_NEAR(static_cast<double>(middle_ns), 0.05e9, 0.005e9);
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    EXPECT_NEAR(clusters[i].mean_time_s + 1e-9 * static_cast<double>(middle_ns),
                before[i].mean_time_s, 1e-15);
  }
  // Once is enough.
  EXPECT_LE(std::abs(CentreTimes(&clusters)), 1);
  std::vector<TimedCluster> none;
  EXPECT_EQ(CentreTimes(&none), 0);
}

TEST(ScanClusters, MergedOnesAreThoseOfTheLargerVoxels) {
  Draws draws(3);
  constexpr double kLeaf = 0.5;
  const std::vector<TimedPoint> points = RandomPoints(4000, &draws);
  const std::vector<TimedCluster> small = BuildScanClusters(points, kLeaf);
  for (const double factor : {2.0, 4.0}) {
    std::vector<std::size_t> group_of;
    const std::vector<TimedCluster> merged = MergeClusters(small, factor * kLeaf, &group_of);
    const std::vector<TimedCluster> expected = BuildScanClusters(points, factor * kLeaf);
    ASSERT_LT(merged.size(), small.size());
    ASSERT_EQ(merged.size(), expected.size());
    for (std::size_t i = 0; i < merged.size(); ++i) {
      EXPECT_EQ(merged[i].points.count, expected[i].points.count);
      EXPECT_LT(MeanGap(merged[i].points, expected[i].points), 1e-10);
      EXPECT_LT(ScatterGap(merged[i].points, expected[i].points), 1e-9);
      EXPECT_NEAR(merged[i].mean_time_s, expected[i].mean_time_s, 1e-12);
      EXPECT_NEAR(merged[i].time_scatter, expected[i].time_scatter, 1e-12);
      EXPECT_LT((merged[i].point_time - expected[i].point_time).norm(), 1e-10);
    }
    ASSERT_EQ(group_of.size(), small.size());
    std::vector<double> counts(merged.size());
    for (std::size_t i = 0; i < small.size(); ++i) counts[group_of[i]] += small[i].points.count;
    for (std::size_t i = 0; i < merged.size(); ++i) {
      EXPECT_EQ(counts[i], merged[i].points.count);
    }
  }
}

TEST(ScanClusters, OfNothingAreNone) {
  EXPECT_TRUE(MergeClusters({}, 1.0).empty());
  EXPECT_TRUE(BuildScanClusters({}, 1.0).empty());
  EXPECT_FALSE(AnyTimed({}));
}

}  // namespace
}  // namespace lamina
