#include "core/geometry/packed_cluster.h"

#include <gtest/gtest.h>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

TEST(PackedCluster, AnEmptyOneStaysEmpty) {
  const Eigen::Vector3d centre(1e5, -3.0, 7.0);
  EXPECT_TRUE(PackedCluster().Empty());
  EXPECT_TRUE(PackedCluster::Of(PointCluster(), centre).Empty());
  EXPECT_TRUE(PackedCluster().Unpacked(centre).Empty());
}

// Far from the origin as near it, and for many points as for few.
TEST(PackedCluster, KeepsMeanAndCovarianceToASmallPartOfItsVoxel) {
  Draws draws(1);
  constexpr double kEdge = 0.8;
  for (int run = 0; run < 1000; ++run) {
    const Eigen::Vector3d centre = draws.InCube(run % 2 == 0 ? 10.0 : 1e5);
    PointCluster cluster;
    for (int i = draws.Integer(1, 40); i > 0; --i) {
      cluster.AddPoint(centre + 0.5 * draws.InCube(kEdge));
    }
    cluster = cluster.Scaled(draws.Uniform(0.01, 1000.0));
    const PointCluster unpacked = PackedCluster::Of(cluster, centre).Unpacked(centre);
    EXPECT_NEAR(unpacked.count, cluster.count, 1e-6 * cluster.count);
    EXPECT_LT((unpacked.mean - cluster.mean).norm(), 5e-8 * kEdge);
    const Eigen::Matrix3d gap = unpacked.Covariance().Dense() - cluster.Covariance().Dense();
    EXPECT_LT(gap.norm(), 5e-8 * kEdge * kEdge);
  }
}

// A wall a tenth of a millimetre thick keeps its thickness.
TEST(PackedCluster, AThinPlaneStaysThin) {
  Draws draws(2);
  for (int run = 0; run < 100; ++run) {
    const Patch patch(draws.InCube(50.0), draws.Direction());
    PointCluster cluster;
    for (int i = 0; i < 200; ++i) cluster.AddPoint(patch.Point(0.4, 1e-4, &draws));
    const PointCluster unpacked = PackedCluster::Of(cluster, patch.centre).Unpacked(patch.centre);
    EXPECT_NEAR(std::sqrt(unpacked.EigenPairs().l(2)), std::sqrt(cluster.EigenPairs().l(2)), 2e-5);
  }
}

}  // namespace
}  // namespace lamina
