#include "core/geometry/cluster_moments.h"

#include <gtest/gtest.h>

#include "core/geometry/packed_cluster.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

void ExpectNear(const PointCluster& a, const PointCluster& b) {
  EXPECT_NEAR(a.count, b.count, 1e-12 * b.count);
  EXPECT_LT((a.mean - b.mean).norm(), 1e-10);
  EXPECT_LT((a.scatter.Dense() - b.scatter.Dense()).norm(), 1e-10);
}

TEST(ClusterMoments, AddRemoveAndExchangeAsClustersDo) {
  Draws draws(1);
  for (int run = 0; run < 1000; ++run) {
    const Eigen::Vector3d origin = draws.InCube(run % 2 == 0 ? 10.0 : 1e4);
    const PointCluster a = ClusterOf(draws.Cloud(draws.Integer(1, 9), origin, 1.0));
    const PointCluster b = ClusterOf(draws.Cloud(draws.Integer(1, 9), origin, 1.0)).Scaled(0.3);
    const PointCluster moved = b.Moved(draws.Offset(0.1 / origin.norm(), 0.1));
    PointCluster sum = a;
    sum += b;
    ClusterMoments moments = ClusterMoments::Of(a, origin);
    moments += ClusterMoments::Of(b, origin);
    ExpectNear(moments.Cluster(origin), sum);
    moments.Exchange(b, moved, origin);
    sum = a;
    sum += moved;
    ExpectNear(moments.Cluster(origin), sum);
    moments -= ClusterMoments::Of(moved, origin);
    ExpectNear(moments.Cluster(origin), a);
    moments -= ClusterMoments::Of(a, origin);
    EXPECT_TRUE(moments.Empty());
    EXPECT_EQ(moments.first.norm() + moments.second.Dense().norm(), 0.0);
    EXPECT_TRUE(moments.Cluster(origin).Empty());
  }
}

// A wall 0.1 mm thick that many frames join and leave in turns keeps its thickness.
TEST(ClusterMoments, AThinPlaneStaysThin) {
  Draws draws(2);
  const Eigen::Vector3d origin = draws.InCube(1e4);
  const Patch patch(origin + draws.InCube(0.4), draws.Direction());
  const auto seen = [&] {
    Points points;
    for (int i = 0; i < 10; ++i) points.push_back(patch.Point(0.4, 1e-4, &draws));
    return ClusterOf(points);
  };
  PointCluster last = seen();
  ClusterMoments moments = ClusterMoments::Of(last, origin);
  for (int i = 0; i < 10000; ++i) {
    const PointCluster next = seen();
    moments += ClusterMoments::Of(next, origin);
    moments -= ClusterMoments::Of(last, origin);
    last = next;
  }
  EXPECT_NEAR(moments.Cluster(origin).EigenPairs().l(2), last.EigenPairs().l(2),
              1e-3 * last.EigenPairs().l(2));
}

TEST(ClusterMoments, OfAPackedClusterAreThoseOfTheUnpackedOne) {
  Draws draws(3);
  for (int run = 0; run < 1000; ++run) {
    const Eigen::Vector3d centre = draws.InCube(1e4);
    const PackedCluster packed =
        PackedCluster::Of(ClusterOf(draws.Cloud(draws.Integer(1, 9), centre, 0.4)), centre);
    ExpectNear(packed.Moments().Cluster(centre), packed.Unpacked(centre));
  }
  EXPECT_TRUE(PackedCluster().Moments().Empty());
}

}  // namespace
}  // namespace lamina
