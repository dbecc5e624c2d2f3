#include "core/geometry/packed_scan.h"

#include <gtest/gtest.h>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

std::vector<TimedCluster> RandomClusters(const Eigen::Vector3d& at, bool timed, Draws* draws) {
  std::vector<TimedCluster> clusters;
  for (int k = 0; k < 200; ++k) {
    TimedCluster c;
    const Eigen::Vector3d place = at + draws->InCube(100.0);
    for (int i = 0; i < 20; ++i) c.points.AddPoint(place + draws->InCube(0.4));
    if (timed) {
      c.mean_time_s = draws->Uniform(-0.05, 0.05);
      c.time_scatter = 20.0 * 1e-6;
      c.point_time = 20.0 * draws->InCube(1e-3);
    }
    clusters.push_back(c);
  }
  return clusters;
}

TEST(PackedScan, KeepsClustersToMicrometresNearAndFar) {
  Draws draws(1);
  for (const double far_m : {0.0, 5e5}) {
    const auto clusters = RandomClusters({far_m, -far_m, 0.0}, true, &draws);
    const PackedScan packed(clusters);
    ASSERT_EQ(packed.size(), clusters.size());
    for (std::size_t i = 0; i < clusters.size(); ++i) {
      const TimedCluster c = packed[i];
      EXPECT_EQ(c.points.count, clusters[i].points.count);
      EXPECT_LT((c.points.mean - clusters[i].points.mean).norm(), 2e-5);
      EXPECT_NEAR(c.points.scatter.xy, clusters[i].points.scatter.xy, 1e-5);
      EXPECT_NEAR(c.mean_time_s, clusters[i].mean_time_s, 1e-8);
      EXPECT_NEAR(c.time_scatter, clusters[i].time_scatter, 1e-10);
      EXPECT_LT((c.point_time - clusters[i].point_time).norm(), 1e-7);
    }
  }
}

TEST(PackedScan, TakesFortyBytesAClusterAndTwentyMoreForItsTimes) {
  Draws draws(2);
  EXPECT_EQ(PackedScan(RandomClusters(Eigen::Vector3d::Zero(), false, &draws)).bytes(), 8000U);
  EXPECT_EQ(PackedScan(RandomClusters(Eigen::Vector3d::Zero(), true, &draws)).bytes(), 12000U);
}

}  // namespace
}  // namespace lamina
