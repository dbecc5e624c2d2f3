#include "core/geometry/point_cluster.h"

#include <gtest/gtest.h>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

// Mean and scatter by their definitions, in extended precision.
PointCluster TwoPassCluster(const Points& points) {
  using Vector3l = Eigen::Matrix<long double, 3, 1>;
  using Matrix3l = Eigen::Matrix<long double, 3, 3>;
  Vector3l mean = Vector3l::Zero();
  for (const Eigen::Vector3d& p : points) mean += p.cast<long double>();
  mean /= static_cast<long double>(points.size());
  Matrix3l scatter = Matrix3l::Zero();
  for (const Eigen::Vector3d& p : points) {
    const Vector3l d = p.cast<long double>() - mean;
    scatter += d * d.transpose();
  }
  PointCluster cluster;
  cluster.count = static_cast<double>(points.size());
  cluster.mean = mean.cast<double>();
  cluster.scatter = Symmetric3::FromDense(scatter.cast<double>());
  return cluster;
}

TEST(PointCluster, AddingPointsAndClustersMeetsTheDefinitions) {
  Draws draws(1);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d centre = draws.InCube(100.0);
    const Points a = draws.Cloud(draws.Integer(1, 30), centre, 2.0);
    const Points b = draws.Cloud(draws.Integer(1, 30), centre, 2.0);
    Points all = a;
    all.insert(all.end(), b.begin(), b.end());
    const PointCluster expected = TwoPassCluster(all);
    PointCluster sum = ClusterOf(a);
    sum += ClusterOf(b);
    EXPECT_EQ(sum.count, expected.count);
    EXPECT_LT(MeanGap(sum, expected), 1e-12);
    EXPECT_LT(ScatterGap(sum, expected), 1e-10);
  }
}

TEST(PointCluster, MovedClusterIsTheClusterOfTheMovedPoints) {
  Draws draws(2);
  for (int i = 0; i < 1000; ++i) {
    const SE3 T = draws.Pose(100.0);
    const Points points = draws.Cloud(draws.Integer(1, 30), draws.InCube(50.0), 2.0);
    Points moved;
    for (const Eigen::Vector3d& p : points) moved.push_back(T * p);
    const PointCluster expected = TwoPassCluster(moved);
    const PointCluster cluster = ClusterOf(points).Moved(T);
    EXPECT_EQ(cluster.count, expected.count);
    EXPECT_LT(MeanGap(cluster, expected), 1e-12 * 300.0);
    EXPECT_LT(ScatterGap(cluster, expected), 1e-10);
  }
}

TEST(PointCluster, RemovingUndoesAdding) {
  Draws draws(3);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d centre = draws.InCube(100.0);
    const PointCluster a = ClusterOf(draws.Cloud(draws.Integer(1, 30), centre, 2.0));
    const PointCluster b = ClusterOf(draws.Cloud(draws.Integer(1, 30), centre, 2.0));
    PointCluster c = a;
    c += b;
    c -= b;
    EXPECT_NEAR(c.count, a.count, 1e-12);
    EXPECT_LT(MeanGap(c, a), 1e-11);
    EXPECT_LT(ScatterGap(c, a), 1e-9);
  }
}

TEST(PointCluster, RemovingAllLeavesAnExactlyEmptyCluster) {
  Draws draws(4);
  for (int i = 0; i < 1000; ++i) {
    std::vector<PointCluster> parts;
    PointCluster sum;
    for (int k = draws.Integer(1, 6); k > 0; --k) {
      const Points points = draws.Cloud(draws.Integer(1, 30), draws.InCube(10.0), 2.0);
      parts.push_back(ClusterOf(points).Scaled(draws.Uniform(0.01, 3.0)));
      sum += parts.back();
    }
    for (const PointCluster& part : parts) sum -= part;
    EXPECT_TRUE(sum.Empty());
    EXPECT_EQ(sum.count, 0.0);
    EXPECT_EQ(sum.mean.norm(), 0.0);
    EXPECT_EQ(sum.scatter.Dense().norm(), 0.0);
  }
}

TEST(PointCluster, EmptyIsNeutral) {
  Draws draws(5);
  const PointCluster a = ClusterOf(draws.Cloud(10, draws.InCube(10.0), 1.0));
  for (const bool from_left : {false, true}) {
    PointCluster sum = from_left ? PointCluster() : a;
    sum += from_left ? a : PointCluster();
    EXPECT_EQ(sum.count, a.count);
    EXPECT_LT(MeanGap(sum, a), 1e-15 * 20.0);
    EXPECT_EQ(ScatterGap(sum, a), 0.0);
  }
  PointCluster both_empty;
  both_empty += PointCluster();
  both_empty -= PointCluster();
  EXPECT_TRUE(both_empty.Empty());
  EXPECT_TRUE(both_empty.mean.allFinite());
}

TEST(PointCluster, ScaledClusterActsAsRepeatedPoints) {
  Draws draws(6);
  for (int i = 0; i < 1000; ++i) {
    const Points points = draws.Cloud(draws.Integer(1, 20), draws.InCube(10.0), 1.0);
    Points thrice;
    for (int k = 0; k < 3; ++k) thrice.insert(thrice.end(), points.begin(), points.end());
    const PointCluster expected = TwoPassCluster(thrice);
    const PointCluster scaled = ClusterOf(points).Scaled(3.0);
    EXPECT_EQ(scaled.count, expected.count);
    EXPECT_LT(MeanGap(scaled, expected), 1e-12);
    EXPECT_LT(ScatterGap(scaled, expected), 1e-11);
    EXPECT_LT((scaled.Covariance().Dense() - ClusterOf(points).Covariance().Dense()).norm(), 1e-13);
  }
}

TEST(PointCluster, CappedClusterKeepsItsShape) {
  Draws draws(8);
  const PointCluster cluster = ClusterOf(draws.Cloud(20, draws.InCube(10.0), 1.0));
  const PointCluster capped = cluster.Capped(5.0);
  EXPECT_EQ(capped.count, 5.0);
  EXPECT_EQ(capped.mean, cluster.mean);
  EXPECT_LT((capped.Covariance().Dense() - cluster.Covariance().Dense()).norm(), 1e-13);
  EXPECT_EQ(cluster.Capped(20.0).count, 20.0);
}

TEST(PointCluster, PlanesStayFlatFarFromTheOrigin) {
  Draws draws(7);
  const Eigen::Vector3d far = 1e5 * Eigen::Vector3d(1.0, -1.0, 0.3);
  for (int i = 0; i < 200; ++i) {
    // Cluster near the sensor, then moved far away: as the map does it.
    const Patch patch(draws.InCube(20.0), draws.Direction());
    PointCluster sum;
    for (int k = 0; k < 20; ++k) {
      const SE3 T_world_lidar(draws.Pose(1.0).q, far + draws.InCube(5.0));
      const SE3 T_lidar_patch = T_world_lidar.Inverse() * SE3(Eigen::Quaterniond::Identity(), far);
      Points seen;
      for (int p = 0; p < 20; ++p) seen.push_back(T_lidar_patch * patch.Point(1.0, 0.0, &draws));
      sum += ClusterOf(seen).Moved(T_world_lidar);
    }
    const Eigen3 eigen = sum.EigenPairs();
    EXPECT_GT(eigen.l(1), 0.1);
    EXPECT_LT(std::abs(eigen.l(2)), 1e-9);
    EXPECT_GT(std::abs(eigen.u.col(2).dot(patch.Normal())), 1.0 - 1e-9);
  }
}

}  // namespace
}  // namespace lamina
