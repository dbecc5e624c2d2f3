#include "core/geometry/point_cluster.h"
#include "core/base/angle.h"

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

struct TimedPoints {
  Points points;
  std::vector<double> times;
};

TimedPoints RandomTimedPoints(double duration_s, Draws* draws) {
  TimedPoints timed;
  timed.points = draws->Cloud(draws->Integer(2, 40), draws->InCube(30.0), 0.5);
  const double middle = draws->Uniform(-0.05, 0.05);
  for (std::size_t i = 0; i < timed.points.size(); ++i) {
    timed.times.push_back(middle + draws->Uniform(-0.5, 0.5) * duration_s);
  }
  return timed;
}

TimedCluster TimedClusterOf(const TimedPoints& timed) {
  TimedCluster c;
  c.points = TwoPassCluster(timed.points);
  for (const double t : timed.times) c.mean_time_s += t / c.points.count;
  for (std::size_t i = 0; i < timed.times.size(); ++i) {
    const double s = timed.times[i] - c.mean_time_s;
    c.time_scatter += s * s;
    c.point_time += s * (timed.points[i] - c.points.mean);
  }
  return c;
}

PointCluster DeskewedOneByOne(const TimedPoints& timed, const Vector6d& twist) {
  Points moved;
  for (std::size_t i = 0; i < timed.points.size(); ++i) {
    moved.push_back(TwistExp(timed.times[i] * twist) * timed.points[i]);
  }
  return TwoPassCluster(moved);
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
    const Eigen3 eigen = sum.Eigen();
    EXPECT_GT(eigen.l(1), 0.1);
    EXPECT_LT(std::abs(eigen.l(2)), 1e-9);
    EXPECT_GT(std::abs(eigen.u.col(2).dot(patch.Normal())), 1.0 - 1e-9);
  }
}

TEST(TimedCluster, DeskewedMeetsDeskewingEachPoint) {
  Draws draws(8);
  for (int i = 0; i < 1000; ++i) {
    const double duration_s = 0.004;  // of one voxel within a sweep
    const TimedPoints timed = RandomTimedPoints(duration_s, &draws);
    const Vector6d twist = draws.Twist(1.5, 20.0);
    const PointCluster deskewed = TimedClusterOf(timed).Deskewed(twist);
    const PointCluster expected = DeskewedOneByOne(timed, twist);
    // The documented order, (|w| s)^2 |p| / 2, and what v adds to it: |w| s |v| s / 2.
    const double s = duration_s;
    const double w = twist.head<3>().norm();
    const double range = expected.mean.norm() + 1.0;
    const double bound = 0.5 * w * s * s * (w * range + twist.tail<3>().norm()) + 1e-12;
    EXPECT_EQ(deskewed.count, expected.count);
    EXPECT_LT(MeanGap(deskewed, expected), bound);
    EXPECT_LT(bound, 3e-3);
    EXPECT_LT(ScatterGap(deskewed, expected), 6.0 * bound * expected.count);
  }
}

TEST(TimedCluster, ErrorFallsWithTheSquareOfTheDuration) {
  Draws draws(9);
  double error_of_all = 0.0, error_of_quick = 0.0;
  for (int i = 0; i < 100; ++i) {
    TimedPoints timed = RandomTimedPoints(0.1, &draws);
    const Vector6d twist = draws.Twist(1.5, 20.0);
    const auto error = [&](double shrink) {
      TimedPoints quick = timed;
      for (double& t : quick.times) t = 0.02 + shrink * (t - 0.02);
      return MeanGap(TimedClusterOf(quick).Deskewed(twist), DeskewedOneByOne(quick, twist));
    };
    error_of_all += error(1.0);
    error_of_quick += error(0.1);
  }
  EXPECT_LT(error_of_quick, 0.015 * error_of_all);
}

TEST(TimedCluster, AQuickTurnDoesNotPushWallsOutwards) {
  // A voxel of a wall whose points come from all of a scan, as a narrow view gives them: the mean
  // over many voxels of what a turn leaves along the line of sight.
  Draws draws(12);
  for (const double turn_deg : {7.0, 14.0, 20.0}) {
    Vector6d twist = Vector6d::Zero();
    twist << 0.0, 0.0, turn_deg * kDegree / 0.1, 1.0, 0.5, 0.0;
    const Eigen::Vector3d place(20.0, 0.0, 0.0);
    double outward = 0.0;
    constexpr int kVoxels = 400;
    for (int i = 0; i < kVoxels; ++i) {
      TimedPoints timed;
      for (int p = 0; p < 50; ++p) {
        timed.points.push_back(place + draws.InCube(0.4));
        timed.times.push_back(draws.Uniform(-0.05, 0.05));
      }
      outward +=
          (TimedClusterOf(timed).Deskewed(twist).mean - DeskewedOneByOne(timed, twist).mean).x();
    }
    EXPECT_NEAR(outward / kVoxels, 0.0, 1e-4) << turn_deg << " deg";
  }
}

TEST(TimedCluster, PureTranslationIsExact) {
  Draws draws(10);
  for (int i = 0; i < 200; ++i) {
    const TimedPoints timed = RandomTimedPoints(0.1, &draws);
    const Vector6d twist = draws.Twist(0.0, 20.0);
    const PointCluster deskewed = TimedClusterOf(timed).Deskewed(twist);
    const PointCluster expected = DeskewedOneByOne(timed, twist);
    EXPECT_LT(MeanGap(deskewed, expected), 1e-12);
    EXPECT_LT(ScatterGap(deskewed, expected), 1e-10);
  }
}

TEST(TimedCluster, WithoutTimesNothingMoves) {
  Draws draws(11);
  TimedCluster c;
  c.points = ClusterOf(draws.Cloud(10, draws.InCube(10.0), 1.0));
  const PointCluster deskewed = c.Deskewed(draws.Twist(1.0, 10.0));
  EXPECT_EQ(MeanGap(deskewed, c.points), 0.0);
  EXPECT_EQ(ScatterGap(deskewed, c.points), 0.0);
}

}  // namespace
}  // namespace lamina
