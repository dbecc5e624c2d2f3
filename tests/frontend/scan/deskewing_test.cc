#include <gtest/gtest.h>

#include <vector>

#include "core/base/angle.h"
#include "frontend/scan/scan_clusters.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

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
  c.points = ClusterOf(timed.points);
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
  return ClusterOf(moved);
}

PointCluster Deskewed(const TimedCluster& cluster, const Vector6d& twist) {
  return DeskewClusters({cluster}, twist)[0];
}

TEST(Deskewing, MeetsThatOfEachPoint) {
  Draws draws(8);
  for (int i = 0; i < 1000; ++i) {
    const double duration_s = 0.004;  // of one voxel within a sweep
    const TimedPoints timed = RandomTimedPoints(duration_s, &draws);
    const Vector6d twist = draws.Twist(1.5, 20.0);
    const PointCluster deskewed = Deskewed(TimedClusterOf(timed), twist);
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

TEST(Deskewing, ErrorFallsWithTheSquareOfTheDuration) {
  Draws draws(9);
  double error_of_all = 0.0, error_of_quick = 0.0;
  for (int i = 0; i < 100; ++i) {
    TimedPoints timed = RandomTimedPoints(0.1, &draws);
    const Vector6d twist = draws.Twist(1.5, 20.0);
    const auto error = [&](double shrink) {
      TimedPoints quick = timed;
      for (double& t : quick.times) t = 0.02 + shrink * (t - 0.02);
      return MeanGap(Deskewed(TimedClusterOf(quick), twist), DeskewedOneByOne(quick, twist));
    };
    error_of_all += error(1.0);
    error_of_quick += error(0.1);
  }
  EXPECT_LT(error_of_quick, 0.015 * error_of_all);
}

TEST(Deskewing, AQuickTurnDoesNotPushWallsOutwards) {
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
          (Deskewed(TimedClusterOf(timed), twist).mean - DeskewedOneByOne(timed, twist).mean).x();
    }
    EXPECT_NEAR(outward / kVoxels, 0.0, 1e-4) << turn_deg << " deg";
  }
}

TEST(Deskewing, PureTranslationIsExact) {
  Draws draws(10);
  for (int i = 0; i < 200; ++i) {
    const TimedPoints timed = RandomTimedPoints(0.1, &draws);
    const Vector6d twist = draws.Twist(0.0, 20.0);
    const PointCluster deskewed = Deskewed(TimedClusterOf(timed), twist);
    const PointCluster expected = DeskewedOneByOne(timed, twist);
    EXPECT_LT(MeanGap(deskewed, expected), 1e-12);
    EXPECT_LT(ScatterGap(deskewed, expected), 1e-10);
  }
}

TEST(Deskewing, WithoutTimesNothingMoves) {
  Draws draws(11);
  TimedCluster c;
  c.points = ClusterOf(draws.Cloud(10, draws.InCube(10.0), 1.0));
  const PointCluster deskewed = Deskewed(c, draws.Twist(1.0, 10.0));
  EXPECT_EQ(MeanGap(deskewed, c.points), 0.0);
  EXPECT_EQ(ScatterGap(deskewed, c.points), 0.0);
}

}  // namespace
}  // namespace lamina
