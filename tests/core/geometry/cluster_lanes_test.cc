#include "core/geometry/cluster_lanes.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

// Any number of them, also such as do not fill the last four.
TEST(ClusterLanes, ManyAreMovedAsEachIs) {
  Draws draws(1);
  for (std::size_t count = 0; count < 14; ++count) {
    std::vector<PointCluster> clusters;
    for (std::size_t i = 0; i < count; ++i) {
      clusters.push_back(ClusterOf(draws.Cloud(draws.Integer(1, 20), draws.InCube(50.0), 0.5)));
    }
    const SE3 T = draws.Pose(30.0);
    // One more, which is not to be written.
    std::vector<PointCluster> moved(count + 1);
    MoveClusters(clusters.data(), count, 4.0, T.R(), T.t, moved.data());
    for (std::size_t i = 0; i < count; ++i) {
      const PointCluster alone = clusters[i].Capped(4.0).Moved(T);
      EXPECT_NEAR(moved[i].count, alone.count, 1e-14 * alone.count);
      EXPECT_LT((moved[i].mean - alone.mean).norm(), 1e-12);
      EXPECT_LT((moved[i].scatter.Dense() - alone.scatter.Dense()).norm(), 1e-13);
    }
    EXPECT_TRUE(moved[count].Empty());
  }
}

TEST(ClusterLanes, TheOthersOfFourChangeNoBitOfACluster) {
  Draws draws(2);
  std::vector<PointCluster> clusters;
  for (int i = 0; i < 11; ++i)
    clusters.push_back(ClusterOf(draws.Cloud(9, draws.InCube(50.0), 1.0)));
  const SE3 T = draws.Pose(30.0);
  std::vector<PointCluster> together(clusters.size());
  MoveClusters(clusters.data(), clusters.size(), 4.0, T.R(), T.t, together.data());
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    PointCluster alone;
    MoveClusters(&clusters[i], 1, 4.0, T.R(), T.t, &alone);
    EXPECT_EQ(alone.count, together[i].count);
    EXPECT_EQ(alone.mean, together[i].mean);
    EXPECT_EQ(alone.scatter.Dense(), together[i].scatter.Dense());
  }
}

}  // namespace
}  // namespace lamina
