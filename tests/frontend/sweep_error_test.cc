#include "frontend/sweep_error.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "frontend/scan_matcher.h"
#include "tests/support/random_rooms.h"

namespace lamina {
namespace {

TEST(RecentAcceleration, IsTheMomentOfLateChangesOfTheTwist) {
  RecentAcceleration recent;
  EXPECT_TRUE(recent.moment().isZero());
  const Vector6d change = 0.3 * Vector6d::Unit(2) - 0.1 * Vector6d::Unit(3);
  for (int i = 0; i < 5; ++i) recent.Add(i % 2 == 0 ? change : Vector6d(-change), 0.1);
  const Matrix6d expected = 100.0 * change * change.transpose();
  EXPECT_LT((recent.moment() - expected).norm(), 1e-9);
  EXPECT_LT((recent.MomentWith(change, 0.1) - expected).norm(), 1e-9);
  StateArchive written;
  recent.Archive(written);
  StateArchive read(written.written());
  RecentAcceleration again;
  again.Archive(read);
  EXPECT_EQ(again.moment(), recent.moment());
  // Steady motion is believed again after some scans, not at once.
  recent.Add(Vector6d::Zero(), 0.1);
  EXPECT_GT(recent.moment()(2, 2), 0.5 * expected(2, 2));
  for (int i = 0; i < 60; ++i) recent.Add(Vector6d::Zero(), 0.1);
  EXPECT_LT(recent.moment()(2, 2), 1e-3 * expected(2, 2));
}

// A room by a sensor that turns about z once a sweep, and accelerates meanwhile: what is left after
// deskewing with the twist since the last pose.
class AcceleratedSweep {
 public:
  static constexpr double kGapS = 0.1;

  AcceleratedSweep(const SE3& T_world_lidar, const Vector6d& acceleration, double begin_s,
                   const Points& world, double leaf_size_m)
      : timed(ScanFrom(T_world_lidar, world, leaf_size_m)) {
    for (TimedCluster& cluster : timed) {
      const Eigen::Vector3d p = cluster.points.mean;
      const double turn = 0.5 - std::atan2(p.y(), p.x()) / (2.0 * M_PI);
      const double tau = cluster.mean_time_s = begin_s + kGapS * turn;
      // Motion over [-T, 0] is known at its ends: a tau^2/2 less the line through those.
      const double g = 0.5 * tau * (tau + kGapS);
      deskewed.push_back(cluster.points);
      deskewed.back().mean -= g * (acceleration.head<3>().cross(p) + acceleration.tail<3>());
    }
  }

  std::vector<TimedCluster> timed;
  std::vector<PointCluster> deskewed;
};

// Errors of poses over their covariance, as a share of 6.
TEST(SweepCovariance, IsThatOfThePosesOfAcceleratedSweeps) {
  Draws draws(3);
  const World world = World::Room();
  VoxelMap map{VoxelMapOptions()};
  FillMap(world, 5, 3000, 0.003, &draws, &map);
  const ScanMatcher matcher{ScanMatcherOptions()};
  for (const double begin_s : {0.0, -0.05}) {
    constexpr int kTrials = 40;
    const double sigma_turn = begin_s == 0.0 ? 2.0 : 5.0, sigma_way = begin_s == 0.0 ? 4.0 : 10.0;
    Matrix6d moment = Matrix6d::Zero();
    moment.diagonal() << Eigen::Vector3d::Constant(sigma_turn * sigma_turn),
        Eigen::Vector3d::Constant(sigma_way * sigma_way);
    double nees = 0.0, nees_without = 0.0;
    for (int trial = 0; trial < kTrials; ++trial) {
      Vector6d acceleration;
      for (int i = 0; i < 6; ++i) acceleration(i) = draws.Normal(i < 3 ? sigma_turn : sigma_way);
      const SE3 truth = draws.Offset(draws.Uniform(0.0, 1.0), 0.6);
      const AcceleratedSweep sweep(truth, acceleration, begin_s, world.Sample(2000, 0.003, &draws),
                                   map.options().LeafSize());
      PosePrediction prediction;
      prediction.T_world_lidar = truth;
      prediction.covariance = 1e-2 * Matrix6d::Identity();
      const MatchResult match = matcher.Match(sweep.deskewed, prediction, map);
      ASSERT_NE(match.status, MatchResult::Status::kTooFewMatches);
      const Vector6d error = LocalDelta(truth, match.T_world_lidar);
      const Matrix6d covariance =
          match.covariance + matcher.SweepCovariance(sweep.deskewed, sweep.timed, match, map,
                                                     AcceleratedSweep::kGapS, moment);
      nees += error.dot(covariance.ldlt().solve(error)) / (6.0 * kTrials);
      nees_without += error.dot(match.covariance.ldlt().solve(error)) / (6.0 * kTrials);
    }
    EXPECT_GT(nees, 0.5) << begin_s;
    EXPECT_LT(nees, 2.0) << begin_s;
    EXPECT_GT(nees_without, 10.0) << begin_s;
  }
}

TEST(SweepCovariance, OfAScanOfOneInstantIsNothing) {
  Draws draws(4);
  const World world = World::Room();
  VoxelMap map{VoxelMapOptions()};
  FillMap(world, 5, 3000, 0.003, &draws, &map);
  const ScanMatcher matcher{ScanMatcherOptions()};
  const auto timed = ScanFrom(SE3(), world.Sample(2000, 0.003, &draws), map.options().LeafSize());
  const std::vector<PointCluster> clusters = Untimed(timed);
  PosePrediction prediction;
  prediction.covariance = 1e-2 * Matrix6d::Identity();
  const MatchResult match = matcher.Match(clusters, prediction, map);
  EXPECT_TRUE(
      matcher.SweepCovariance(clusters, timed, match, map, 0.1, Matrix6d::Identity()).isZero());
}

}  // namespace
}  // namespace lamina
