#include "frontend/odometry/sweep_acceleration.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "frontend/matching/scan_matcher.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

TEST(RecentAccelerations, AreTheSecondMomentOfEstimatesAndOfWhatTheyLeaveOpen) {
  const MotionOptions options;
  RecentAccelerations recent(options);
  EXPECT_NEAR(std::sqrt(recent.Moment()(3, 3)), options.acceleration_sigma_m_s2, 0.05);
  SweepAcceleration estimate;
  estimate.acceleration = 3.0 * Vector6d::Unit(2) - 1.0 * Vector6d::Unit(3);
  estimate.covariance = 0.5 * Matrix6d::Identity();
  for (int i = 0; i < 100; ++i) {
    recent.Add(estimate);
    estimate.acceleration *= -1.0;
  }
  const Matrix6d expected = estimate.acceleration * estimate.acceleration.transpose() +
                            estimate.covariance +
                            0.01 * RecentAccelerations(options).Moment() / 1.01;
  EXPECT_LT((recent.Moment() - expected).norm(), 1e-3 * expected.norm());
  StateArchive written;
  recent.Archive(written);
  StateArchive read(written.written());
  RecentAccelerations again(options);
  again.Archive(read);
  EXPECT_EQ(again.Moment(), recent.Moment());
  // Steady motion is believed again after some scans, not at once.
  recent.Add(SweepAcceleration());
  EXPECT_GT(recent.Moment()(2, 2), 0.5 * expected(2, 2));
  for (int i = 0; i < 100; ++i) recent.Add(SweepAcceleration());
  EXPECT_LT(recent.Moment()(2, 2), 0.05 * expected(2, 2));
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

// A pose found in a room, and what its sweep tells of the acceleration.
struct Found {
  MatchResult match;
  SweepAcceleration unsteady;
};

class EstimatedAcceleration : public ::testing::Test {
 protected:
  EstimatedAcceleration() { FillMap(world_, 5, 3000, 0.003, &draws_, &map_); }

  // `deskewed`: under steady motion over the gap.
  Found Find(const SE3& near, const std::vector<PointCluster>& deskewed,
             const std::vector<TimedCluster>& timed, const Matrix6d& moment) const {
    const ScanMatcherOptions options;
    PosePrediction prediction;
    prediction.T_world_lidar = near;
    prediction.covariance = 1e-2 * Matrix6d::Identity();
    Found found;
    found.match = ScanMatcher(options).Match(deskewed, prediction, map_);
    found.unsteady = EstimateAcceleration(options, deskewed, timed, found.match, map_,
                                          AcceleratedSweep::kGapS, moment);
    return found;
  }

  Draws draws_{3};
  World world_ = World::Room();
  VoxelMap map_{VoxelMapOptions()};
};

TEST_F(EstimatedAcceleration, IsThatOfTheSweepAndPutsThePoseRight) {
  for (const double begin_s : {0.0, -0.05}) {
    constexpr int kTrials = 40;
    const double sigma_turn = begin_s == 0.0 ? 2.0 : 5.0, sigma_way = begin_s == 0.0 ? 4.0 : 10.0;
    Matrix6d moment = Matrix6d::Zero();
    moment.diagonal() << Eigen::Vector3d::Constant(sigma_turn * sigma_turn),
        Eigen::Vector3d::Constant(sigma_way * sigma_way);
    double nees = 0.0, off = 0.0, off_matched = 0.0, left = 0.0;
    for (int trial = 0; trial < kTrials; ++trial) {
      Vector6d acceleration;
      for (int i = 0; i < 6; ++i) acceleration(i) = draws_.Normal(i < 3 ? sigma_turn : sigma_way);
      const SE3 truth = draws_.Offset(draws_.Uniform(0.0, 1.0), 0.6);
      const AcceleratedSweep sweep(truth, acceleration, begin_s,
                                   world_.Sample(2000, 0.003, &draws_), map_.options().LeafSize());
      const Found found = Find(truth, sweep.deskewed, sweep.timed, moment);
      ASSERT_NE(found.match.status, MatchResult::Status::kTooFewMatches);
      const Vector6d error = acceleration - found.unsteady.acceleration;
      nees += error.dot(found.unsteady.covariance.ldlt().solve(error)) / (6.0 * kTrials);
      left += error.squaredNorm() / acceleration.squaredNorm() / kTrials;
      const SE3 stepped = Retract(found.match.T_world_lidar, found.unsteady.pose_step);
      off += LocalDelta(truth, stepped).norm() / kTrials;
      off_matched += LocalDelta(truth, found.match.T_world_lidar).norm() / kTrials;
    }
    EXPECT_LT(left, 0.3) << begin_s;
    EXPECT_LT(nees, 2.0) << begin_s;
    EXPECT_LT(off, 0.5 * off_matched) << begin_s;
  }
}

TEST_F(EstimatedAcceleration, OfAScanOfOneInstantIsWhatWasKnownBefore) {
  const auto timed =
      ScanFrom(SE3(), world_.Sample(2000, 0.003, &draws_), map_.options().LeafSize());
  const Matrix6d moment = 4.0 * Matrix6d::Identity();
  const Found found = Find(SE3(), Untimed(timed), timed, moment);
  EXPECT_TRUE(found.unsteady.acceleration.isZero());
  EXPECT_LT((found.unsteady.covariance - moment).norm(), 1e-6);
  EXPECT_TRUE(found.unsteady.pose_covariance.isZero());
}

TEST_F(EstimatedAcceleration, OfAScanThatMeetsNothingIsNone) {
  const auto timed =
      ScanFrom(SE3(), world_.Sample(2000, 0.003, &draws_), map_.options().LeafSize());
  SE3 elsewhere;
  elsewhere.t.x() = 500.0;
  const Found found = Find(elsewhere, Untimed(timed), timed, Matrix6d::Identity());
  EXPECT_EQ(found.match.status, MatchResult::Status::kTooFewMatches);
  EXPECT_TRUE(found.unsteady.covariance.isZero());
}

}  // namespace
}  // namespace lamina
