#include "frontend/odometry/shaken_sweep.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/angle.h"
#include "tests/support/scenes/random_rooms.h"
#include "tests/support/scenes/shaken_sensor.h"

namespace lamina {
namespace {

class ShakenSweepTest : public ::testing::Test {
 protected:
  ShakenSweepTest() { FillMap(world_, 5, 3000, 0.003, &draws_, &map_); }

  struct Found {
    bool suspected = false, better = false;
    MatchResult plain, match;
    SweepMotion sweep;
    Matrix6d pose_covariance = Matrix6d::Zero();
  };

  // By odometry's way to the scan: deskewed and matched by the mean velocity since the last pose.
  // The points' times, `per_s` a second. `goes_on`: the scan before it was shaken.
  Found Find(const ShakenSensor& sensor, double per_s = 1.0, bool goes_on = false) {
    const auto timed =
        sensor.Sweep(world_.Sample(2000, 0.003, &draws_), map_.options().LeafSize(), per_s);
    const SE3 T_last = sensor.At(-ShakenSensor::kGapS);
    const Vector6d before =
        TwistLog(sensor.At(-2.0 * ShakenSensor::kGapS).Inverse() * T_last) / ShakenSensor::kGapS;
    PosePrediction prediction;
    prediction.T_world_lidar = T_last * TwistExp(ShakenSensor::kGapS * before);
    prediction.covariance = 1e-2 * Matrix6d::Identity();
    const ScanMatcher matcher{ScanMatcherOptions()};
    Found found;
    std::vector<PointCluster> deskewed = DeskewClusters(timed, before);
    found.plain = matcher.Match(deskewed, prediction, map_);
    found.sweep =
        SweepMotion(TwistLog(T_last.Inverse() * found.plain.T_world_lidar) / ShakenSensor::kGapS);
    DeskewClusters(timed, found.sweep, &deskewed);
    found.plain = matcher.Match(deskewed, prediction, found.plain.T_world_lidar, map_);
    found.match = found.plain;
    const ShakenSweep shaken(matcher.options(), MotionOptions());
    const ShakenScan scan{timed, map_, prediction, T_last, ShakenSensor::kGapS, false, goes_on};
    found.suspected = shaken.Suspected(scan, found.plain);
    found.better = shaken.Find(scan, &deskewed, &found.match, &found.sweep, &found.pose_covariance);
    return found;
  }

  Draws draws_{3};
  World world_ = World::Room();
  VoxelMap map_{VoxelMapOptions()};
};

// At 5 Hz a sweep lasts half a period: the poses before and after it do not tell how the sensor
// moved meanwhile, and the prediction is off by up to four times the amplitude.
TEST_F(ShakenSweepTest, IsFoundWhereThePosesAboutItDoNotTellIt) {
  for (const double phase : {0.0, 0.8, 1.6, 2.4}) {
    SCOPED_TRACE(testing::Message() << "phase " << phase);
    const ShakenSensor sensor(1.5 * kDegree, 5.0, phase);
    const Found found = Find(sensor);
    ASSERT_TRUE(found.better);
    EXPECT_TRUE(found.suspected);
    EXPECT_TRUE(found.sweep.of_scan);
    const SE3 truth = sensor.At(0.0);
    EXPECT_LT(RotationAngle(found.match.T_world_lidar, truth), 0.35 * kDegree);
    EXPECT_LT(RotationAngle(found.match.T_world_lidar, truth),
              RotationAngle(found.plain.T_world_lidar, truth));
    EXPECT_LT((found.match.T_world_lidar.t - truth.t).norm(), 0.02);
    EXPECT_GT(found.match.fit(), found.plain.fit());
    for (const double tau : {-0.04, -0.02, 0.02, 0.04}) {
      EXPECT_LT(RotationAngle(found.sweep.PoseAt(tau), truth.Inverse() * sensor.At(tau)),
                0.65 * kDegree)
          << tau;
    }
  }
}

TEST_F(ShakenSweepTest, OfASteadySensorIsNotSuspected) {
  const Found found = Find(ShakenSensor(0.0, 5.0, 0.0));
  EXPECT_FALSE(found.suspected);
  EXPECT_FALSE(found.better);
  EXPECT_FALSE(found.sweep.of_scan);
  EXPECT_EQ(found.match.T_world_lidar.t, found.plain.T_world_lidar.t);
}

// What a hand does, or a brake: expected by the motion options, and the ordinary way's to find.
TEST_F(ShakenSweepTest, AnAccelerationThatIsExpectedIsNone) {
  for (const double phase : {0.0, 0.8, 1.6, 2.4}) {
    const Found found = Find(ShakenSensor(3.0 * kDegree, 1.0, phase));
    EXPECT_FALSE(found.better) << phase;
    EXPECT_FALSE(found.sweep.of_scan) << phase;
    EXPECT_EQ(found.match.T_world_lidar.t, found.plain.T_world_lidar.t) << phase;
  }
}

// A shake that becomes weaker, scan by scan, is none that is expected at first and one that is at
// the end; the mean velocity bends the scans of both.
TEST_F(ShakenSweepTest, IsFoundAsLongAsItGoesOn) {
  for (const double phase : {0.0, 0.8, 1.6, 2.4}) {
    SCOPED_TRACE(testing::Message() << "phase " << phase);
    const ShakenSensor weak(0.8 * kDegree, 5.0, phase), steady(0.0, 5.0, phase);
    EXPECT_FALSE(Find(weak).better);
    const Found found = Find(weak, 1.0, true);
    EXPECT_TRUE(found.better);
    EXPECT_LT(RotationAngle(found.match.T_world_lidar, weak.At(0.0)),
              RotationAngle(found.plain.T_world_lidar, weak.At(0.0)));
    EXPECT_FALSE(Find(steady, 1.0, true).better);
  }
}

// A sweep that seems to last for two gaps: points' times that are none of this scan's, which a
// motion could make up for.
TEST_F(ShakenSweepTest, TimesBeyondTheGapAreNotSuspected) {
  const ShakenSensor sensor(1.5 * kDegree, 5.0, 0.8);
  EXPECT_TRUE(Find(sensor).suspected);
  EXPECT_FALSE(Find(sensor, 2.0).suspected);
}

TEST_F(ShakenSweepTest, OfAScanThatMeetsNothingIsNone) {
  const ShakenSensor sensor(1.5 * kDegree, 5.0, 0.0);
  const auto timed = sensor.Sweep(world_.Sample(500, 0.003, &draws_), map_.options().LeafSize());
  SE3 elsewhere;
  elsewhere.t.x() = 500.0;
  PosePrediction prediction;
  prediction.T_world_lidar = elsewhere;
  const ShakenSweep shaken{ScanMatcherOptions(), MotionOptions()};
  const ShakenScan scan{timed, map_, prediction, elsewhere, ShakenSensor::kGapS, false, false};
  std::vector<PointCluster> deskewed;
  MatchResult match;
  match.T_world_lidar = elsewhere;
  SweepMotion sweep;
  Matrix6d pose_covariance;
  EXPECT_FALSE(shaken.Find(scan, &deskewed, &match, &sweep, &pose_covariance));
  EXPECT_EQ(match.status, MatchResult::Status::kTooFewMatches);
  EXPECT_FALSE(sweep.of_scan);
}

}  // namespace
}  // namespace lamina
