#include "frontend/odometry/motion_model.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace lamina {
namespace {

constexpr StampNs kPeriodNs = 100000000;

SE3 Along(double x) { return SE3(Eigen::Quaterniond::Identity(), {x, 0.0, 0.0}); }

double WaySigma(const MotionModel& model, StampNs stamp_ns) {
  return std::sqrt(model.Predict(stamp_ns).covariance(3, 3));
}

// At 15 m/s along x; the last pose at 15 m, one second after the first.
MotionModel Driving() {
  MotionModel model{MotionOptions()};
  for (int i = 0; i <= 10; ++i) model.Accept(i * kPeriodNs, Along(1.5 * i), i > 0);
  return model;
}

TEST(MotionModel, UncertaintyGrowsWithTheGap) {
  const MotionModel model = Driving();
  double last = 0.0;
  for (int k = 1; k <= 50; ++k) {
    const double sigma = WaySigma(model, (10 + k) * kPeriodNs);
    EXPECT_GT(sigma, last);
    last = sigma;
  }
  EXPECT_LT(WaySigma(model, 11 * kPeriodNs), 0.05);
  // A car that brakes with 8 m/s^2 from the last pose on stays within two standard deviations.
  EXPECT_GT(2.0 * WaySigma(model, 20 * kPeriodNs), 0.5 * 8.0);
}

// However long the gap over which it was measured.
TEST(MotionModel, AVelocityIsKnownNoWorseThanNone) {
  MotionModel model = Driving();
  const StampNs found = 310 * kPeriodNs, next = found + kPeriodNs;
  model.Accept(found, Along(465.0), true);
  const Vector6d at_start = model.PredictAsAtStart(next).covariance.diagonal();
  const Vector6d after_gap = model.Predict(next).covariance.diagonal();
  EXPECT_LE(after_gap(0), at_start(0) + 1e-12);
  EXPECT_LE(after_gap(3), at_start(3) + 1e-12);
  // Measured from scan to scan while it was lost, it is as good as ever.
  model.Assume(model.velocity(), 0.1);
  EXPECT_LT(WaySigma(model, next), 0.05);
}

TEST(MotionModel, AVehicleIsExpectedAheadAfterAGap) {
  const MotionModel model = Driving();
  EXPECT_NEAR(model.Predict(11 * kPeriodNs).T_world_lidar.t.x(), 16.5, 1e-9);
  EXPECT_NEAR(model.Predict(25 * kPeriodNs).T_world_lidar.t.x(), 15.0 + 22.5, 1.5);
}

TEST(MotionModel, WithoutStampsTheNextStepMayBeHalfAsLongOrHalfAsLongAgain) {
  MotionModel model = Driving();
  model.SetStampsRecorded(false);
  EXPECT_GT(WaySigma(model, 11 * kPeriodNs), 0.75 - 1e-9);
  EXPECT_LT(WaySigma(model, 11 * kPeriodNs), 0.80);
  // A short step is no promise that the next one is short.
  model.Accept(11 * kPeriodNs, Along(15.1), true);
  EXPECT_GT(WaySigma(model, 12 * kPeriodNs), 0.6);
  model.SetStampsRecorded(true);
  EXPECT_LT(WaySigma(model, 12 * kPeriodNs), 0.05);
}

TEST(MotionModel, WithoutStampsAStartMayBeFarAway) {
  MotionModel model{MotionOptions()};
  model.Accept(0, Along(0.0), false);
  model.SetStampsRecorded(false);
  EXPECT_GT(WaySigma(model, kPeriodNs), 4.0);
}

TEST(MotionModel, APoseThatIsTakenBackIsNoMotion) {
  const auto speed_after = [](double x) {
    MotionModel model = Driving();
    model.Accept(11 * kPeriodNs, Along(x), true);
    return model.velocity()(3);
  };
  // Braking and speeding up, as hard as tyres let it.
  EXPECT_NEAR(speed_after(16.5 - 0.1), 14.0, 1e-9);
  EXPECT_NEAR(speed_after(16.5 + 0.1), 16.0, 1e-9);
  // The poses before were 3 m too far ahead: still on its way at about that speed.
  EXPECT_GT(speed_after(13.5), 12.0);
  EXPECT_LT(speed_after(13.5), 15.0);
  // Where they were known so badly, it may as well have stood.
  MotionModel open{MotionOptions()};
  Matrix6d badly = Matrix6d::Zero();
  badly(3, 3) = 1.0;
  for (int i = 0; i <= 10; ++i) open.Accept(i * kPeriodNs, Along(1.5 * i), i > 0, badly);
  open.Accept(11 * kPeriodNs, Along(15.0), true, badly);
  EXPECT_LT(open.velocity()(3), speed_after(15.0));
}

TEST(MotionModel, BeforeAnyMotionTheSpeedIsUnknown) {
  MotionModel model{MotionOptions()};
  model.Accept(0, Along(0.0), false);
  EXPECT_FALSE(model.moving_known());
  EXPECT_GT(WaySigma(model, kPeriodNs), 1.0);
  model.Accept(kPeriodNs, Along(1.5), true);
  EXPECT_TRUE(model.moving_known());
  EXPECT_LT(WaySigma(model, 2 * kPeriodNs), 0.1);
}

TEST(MotionModel, AsAtAStartThePredictionIsTheLastPoseAndAllThatAStartLeavesOpen) {
  const MotionModel driving = Driving();
  MotionModel start{MotionOptions()};
  start.Accept(10 * kPeriodNs, Along(15.0), false);
  const PosePrediction expected = start.Predict(20 * kPeriodNs);
  const PosePrediction prediction = driving.PredictAsAtStart(20 * kPeriodNs);
  EXPECT_EQ(prediction.T_world_lidar.t, expected.T_world_lidar.t);
  EXPECT_EQ(prediction.covariance, expected.covariance);
  EXPECT_GT(driving.Predict(20 * kPeriodNs).T_world_lidar.t.x(), 20.0);
}

TEST(MotionModel, AnAssumedVelocityMovesThePredictionAndIsNoBetterKnown) {
  MotionModel model{MotionOptions()};
  model.Accept(0, Along(0.0), false);
  const double sigma = WaySigma(model, kPeriodNs);
  Vector6d velocity = Vector6d::Zero();
  velocity(3) = 10.0;
  model.Assume(velocity);
  EXPECT_NEAR(model.Predict(kPeriodNs).T_world_lidar.t.x(), 1.0, 1e-9);
  EXPECT_EQ(WaySigma(model, kPeriodNs), sigma);
}

TEST(MotionModel, AVelocityThatIsKnownAtTheStartIsAsGoodAsAMeasuredOne) {
  MotionModel model{MotionOptions()};
  model.Accept(0, Along(0.0), false);
  model.StartMoving(15.0 * Vector6d::Unit(3));
  EXPECT_TRUE(model.moving_known());
  EXPECT_NEAR(model.Predict(kPeriodNs).T_world_lidar.t.x(), 1.5, 1e-9);
  EXPECT_EQ(WaySigma(model, kPeriodNs), WaySigma(Driving(), 11 * kPeriodNs));
}

TEST(MotionModel, SetDownSomewhereItIsExpectedThere) {
  MotionModel model = Driving();
  model.StartAt(Along(15.0));
  EXPECT_EQ(model.Predict(5).T_world_lidar.t.x(), 15.0);
  EXPECT_EQ(model.Twist(5).norm(), 0.0);
  EXPECT_GT(WaySigma(model, 5), 5.0);
}

TEST(MotionModel, BeforeAMotionIsKnownTheVelocityIsAnyOfAStart) {
  MotionModel model{MotionOptions()};
  model.Accept(0, SE3(), false);
  const auto speed_sigma = [&] { return std::sqrt(model.VelocityChange(0.1)(3, 3)); };
  EXPECT_NEAR(speed_sigma(), MotionOptions().start_speed_sigma_m_s, 1e-9);
  model.Accept(kPeriodNs, Along(1.5), true);
  EXPECT_NEAR(speed_sigma(), 0.1 * MotionOptions().acceleration_sigma_m_s2, 1e-9);
}

TEST(MotionModel, WithoutRecordedStampsTheVelocityChangesByWhatStepsHave) {
  MotionModel model = Driving();
  const auto speed_sigma = [&] { return std::sqrt(model.VelocityChange(0.1)(3, 3)); };
  const double clocked = 0.1 * MotionOptions().acceleration_sigma_m_s2;
  // Even steps are a clock themselves; one of 3 m after many of 1.5 m is not.
  model.SetStampsRecorded(false);
  EXPECT_NEAR(speed_sigma(), clocked, 1e-9);
  model.Accept(11 * kPeriodNs, Along(18.0), true);
  EXPECT_TRUE(model.uneven());
  EXPECT_GT(speed_sigma(), 10.0);
  EXPECT_LT(speed_sigma(), 20.0);
  // Forgotten with so many even ones.
  for (int k = 1; k < 20; ++k) model.Accept((11 + k) * kPeriodNs, Along(18.0 + 3.0 * k), true);
  EXPECT_NEAR(speed_sigma(), clocked, 1e-9);
  model.Accept(31 * kPeriodNs, Along(76.5), true);
  model.SetStampsRecorded(true);
  EXPECT_NEAR(speed_sigma(), clocked, 1e-9);
}

TEST(MotionModel, PosesThatWereHeldLeaveTheNextOneOpen) {
  const auto drift_m = [](const MotionModel& model, StampNs stamp_ns) {
    return std::sqrt(model.Drift(stamp_ns)(3, 3));
  };
  const Matrix6d well = 1e-6 * Matrix6d::Identity();
  MotionModel model = Driving();
  model.Accept(11 * kPeriodNs, Along(16.5), true, well);
  model.Accept(12 * kPeriodNs, Along(18.0), true, well);
  EXPECT_LT(drift_m(model, 13 * kPeriodNs), 0.005);
  // Poses that are little more than predictions: as unsure as these, and more with each.
  Matrix6d held = well;
  double last = 0.0;
  for (int k = 13; k < 18; ++k) {
    held(3, 3) += 0.04 * 0.04;
    model.Accept(k * kPeriodNs, Along(1.5 * k), true, held);
    EXPECT_GT(drift_m(model, (k + 1) * kPeriodNs), std::max(last, 0.04));
    last = drift_m(model, (k + 1) * kPeriodNs);
  }
  model.Accept(18 * kPeriodNs, Along(27.0), true, well);
  model.Accept(19 * kPeriodNs, Along(28.5), true, well);
  EXPECT_LT(drift_m(model, 20 * kPeriodNs), 0.01);
}

}  // namespace
}  // namespace lamina
