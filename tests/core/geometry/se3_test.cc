#include "core/geometry/se3.h"

#include <gtest/gtest.h>

#include <random>

namespace lamina {
namespace {

SE3 RandomPose(std::mt19937* random, double translation_m) {
  std::normal_distribution<double> normal;
  const Eigen::Quaterniond q(normal(*random), normal(*random), normal(*random), normal(*random));
  return SE3(q, translation_m * Eigen::Vector3d(normal(*random), normal(*random), normal(*random)));
}

TEST(SE3, LogInvertsExpForAllAngles) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> angle(0.0, 3.1415);
  for (int i = 0; i < 1000; ++i) {
    const double theta = i % 2 == 0 ? angle(random) : 1e-7 * angle(random);
    const Eigen::Vector3d w = theta * RandomPose(&random, 1.0).t.normalized();
    EXPECT_LT((LogSO3(ExpSO3(w)) - w).norm(), 1e-12) << "angle " << theta;
  }
}

TEST(SE3, LocalDeltaInvertsRetract) {
  std::mt19937 random(2);
  for (int i = 0; i < 1000; ++i) {
    const SE3 a = RandomPose(&random, 100.0);
    const SE3 b = RandomPose(&random, 100.0);
    const SE3 c = Retract(a, LocalDelta(a, b));
    EXPECT_LT(RotationAngle(b, c), 1e-12);
    EXPECT_LT((b.t - c.t).norm(), 1e-12);
  }
}

TEST(SE3, TwistLogInvertsTwistExp) {
  std::mt19937 random(3);
  for (int i = 0; i < 1000; ++i) {
    Vector6d twist;
    twist << 0.5 * RandomPose(&random, 1.0).t.normalized(), RandomPose(&random, 3.0).t;
    if (i % 3 == 0) twist.head<3>() *= 1e-5;
    EXPECT_LT((TwistLog(TwistExp(twist)) - twist).norm(), 1e-9);
  }
}

TEST(SE3, TwistExpOfHalvesComposes) {
  std::mt19937 random(4);
  for (int i = 0; i < 1000; ++i) {
    Vector6d twist;
    twist << RandomPose(&random, 1.0).t, RandomPose(&random, 3.0).t;
    const SE3 whole = TwistExp(twist);
    const SE3 halves = TwistExp(0.3 * twist) * TwistExp(0.7 * twist);
    EXPECT_LT(RotationAngle(whole, halves), 1e-12);
    EXPECT_LT((whole.t - halves.t).norm(), 1e-11);
  }
}

TEST(SE3, InterpolateMeetsBothEndsAndExtrapolatesTheTwist) {
  std::mt19937 random(5);
  const SE3 a = RandomPose(&random, 10.0);
  Vector6d twist;
  twist << 0.1, -0.2, 0.05, 1.0, 2.0, -0.5;
  const SE3 b = a * TwistExp(twist);
  EXPECT_LT((Interpolate(a, b, 0.0).t - a.t).norm(), 1e-12);
  EXPECT_LT((Interpolate(a, b, 1.0).t - b.t).norm(), 1e-12);
  EXPECT_LT((Interpolate(a, b, 2.0).t - (b * TwistExp(twist)).t).norm(), 1e-12);
}

// A product A * B^-1 * A with plain matrices loses orthonormality exponentially.
TEST(SE3, ConstantVelocityChainStaysOrthonormal) {
  std::mt19937 random(6);
  SE3 before = RandomPose(&random, 1.0);
  SE3 now = Retract(before, 0.01 * Vector6d::Ones());
  for (int i = 0; i < 10000; ++i) {
    const SE3 next = now * before.Inverse() * now;
    before = now;
    now = next;
  }
  EXPECT_NEAR(now.q.norm(), 1.0, 1e-12);
  EXPECT_LT((now.R() * now.R().transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
}

}  // namespace
}  // namespace lamina
