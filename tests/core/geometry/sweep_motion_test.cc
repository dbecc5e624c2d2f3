#include "core/geometry/sweep_motion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <functional>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

constexpr double kMaxGapS = 0.5;

// Poses of a motion whose velocity changes steadily, about one axis, as far as it is exact.
Trajectory Accelerated(const SweepMotion& motion, const std::vector<StampNs>& stamps) {
  Trajectory poses;
  for (const StampNs stamp : stamps)
    poses.push_back({stamp, motion.PoseAt(SecondsBetween(0, stamp))});
  return poses;
}

TEST(SweepMotion, ThroughThreePosesIsTheirs) {
  SweepMotion motion;
  motion.twist << 0.0, 0.0, 0.8, 0.0, 0.0, 0.2;
  motion.acceleration << 0.0, 0.0, -3.0, 0.0, 0.0, 5.0;
  constexpr StampNs kMs = 1000000;
  // Unevenly spread, as where scans were dropped.
  const Trajectory poses = Accelerated(motion, {-200 * kMs, 0, 100 * kMs});
  SweepMotion found;
  ASSERT_TRUE(MotionThrough(poses, 1, kMaxGapS, &found));
  EXPECT_LT((found.twist - motion.twist).norm(), 1e-9);
  EXPECT_LT((found.acceleration - motion.acceleration).norm(), 1e-9);
  // The first of them has the acceleration of the next.
  ASSERT_TRUE(MotionThrough(poses, 0, kMaxGapS, &found));
  EXPECT_LT((found.twist - motion.TwistAt(-0.2)).norm(), 1e-9);
  for (const double tau : {-0.2, 0.1}) {
    const StampedPose at{static_cast<StampNs>(tau * 1e9), motion.PoseAt(tau)};
    EXPECT_LT(
        LocalDelta(found.PoseAt(tau + 0.2), poses[0].T_world_lidar.Inverse() * at.T_world_lidar)
            .norm(),
        1e-9);
  }
}

// A car that goes straight on its springs: 10 m/s, heaving by 1.5 cm and rolling by 0.4 degrees
// somewhat more than once a second.
SE3 OnSprings(double t) {
  return SE3(ExpSO3(0.007 * std::sin(7.0 * t + 1.0) * Eigen::Vector3d::UnitX()),
             {10.0 * t, 0.0, 0.015 * std::sin(9.0 * t)});
}

// The mean over the scans of a path, at 10 Hz, of how far apart the true path and the motion that
// is found are at the ends of their sweeps; each within `beside` poses on either side.
double MeanErrorAtEnds(const std::function<SE3(double)>& path, const Trajectory& poses,
                       std::size_t beside) {
  constexpr double kEndS = 0.05;
  double sum = 0.0;
  int count = 0;
  for (std::size_t i = beside; i + beside < poses.size(); ++i) {
    const auto pose = poses.begin() + static_cast<std::ptrdiff_t>(i);
    const auto reach = static_cast<std::ptrdiff_t>(beside);
    SweepMotion found;
    EXPECT_TRUE(
        MotionThrough(Trajectory(pose - reach, pose + reach + 1), beside, kMaxGapS, &found));
    const double t = SecondsBetween(0, pose->stamp_ns);
    for (const double tau : {-kEndS, kEndS}) {
      sum += LocalDelta(path(t).Inverse() * path(t + tau), found.PoseAt(tau)).norm();
      ++count;
    }
  }
  return sum / count;
}

TEST(SweepMotion, PosesBeyondTheNeighboursTellOfAVibration) {
  Trajectory poses;
  for (int k = 0; k < 40; ++k) poses.push_back({k * StampNs{100000000}, OnSprings(0.1 * k)});
  const double three = MeanErrorAtEnds(OnSprings, poses, 1);
  EXPECT_GT(three, 4e-4);
  EXPECT_LT(MeanErrorAtEnds(OnSprings, poses, kMotionNeighbours), 0.25 * three);
  // Stamps that jitter, and every fifth scan dropped.
  Draws draws(3);
  Trajectory uneven;
  for (int k = 0; k < 40; ++k) {
    if (k % 5 == 4) continue;
    const double t = 0.1 * k + draws.Uniform(-0.01, 0.01);
    const auto stamp_ns = static_cast<StampNs>(1e9 * t);
    uneven.push_back({stamp_ns, OnSprings(SecondsBetween(0, stamp_ns))});
  }
  EXPECT_LT(MeanErrorAtEnds(OnSprings, uneven, kMotionNeighbours),
            0.5 * MeanErrorAtEnds(OnSprings, uneven, 1));
}

// What poses are off by must not bend the scans more than it has to: the poses beyond the
// neighbours, which would add to it, are left alone where they show nothing else.
TEST(SweepMotion, NoiseOfPosesIsNotTakenForMotion) {
  const auto steady = [](double t) {
    return SE3(Eigen::Quaterniond::Identity(), {10.0 * t, 0.0, 0.0});
  };
  Draws draws(4);
  Trajectory poses;
  for (int k = 0; k < 400; ++k) {
    poses.push_back({k * StampNs{100000000}, steady(0.1 * k)});
    poses.back().T_world_lidar.t +=
        0.003 * Eigen::Vector3d(draws.Normal(1.0), draws.Normal(1.0), draws.Normal(1.0));
  }
  EXPECT_LT(MeanErrorAtEnds(steady, poses, kMotionNeighbours),
            1.1 * MeanErrorAtEnds(steady, poses, 1));
}

TEST(SweepMotion, AtTheEndKeepsTheAccelerationAndTheWay) {
  Draws draws(1);
  const Trajectory poses{{0, SE3()}, {100000000, draws.Offset(0.1, 1.0)}};
  SweepMotion motion(Vector6d::Zero(), draws.Twist(3.0, 5.0));
  const Vector6d acceleration = motion.acceleration;
  ASSERT_TRUE(MotionThrough(poses, 1, kMaxGapS, &motion));
  EXPECT_EQ(motion.acceleration, acceleration);
  const SE3 T_last_first = poses[1].T_world_lidar.Inverse() * poses[0].T_world_lidar;
  EXPECT_LT(LocalDelta(motion.PoseAt(-0.1), T_last_first).norm(), 1e-9);
}

TEST(SweepMotion, KnowsNoneAcrossALongGapOrBackwards) {
  SweepMotion motion(Vector6d::Ones());
  for (const StampNs second : {StampNs{600000000}, StampNs{0}, StampNs{-100000000}}) {
    const Trajectory poses{{0, SE3()}, {second, SE3(Eigen::Quaterniond::Identity(), {1, 0, 0})}};
    EXPECT_FALSE(MotionThrough(poses, 0, kMaxGapS, &motion));
    EXPECT_FALSE(MotionThrough(poses, 1, kMaxGapS, &motion));
  }
  EXPECT_FALSE(MotionThrough({{0, SE3()}}, 0, kMaxGapS, &motion));
  EXPECT_EQ(motion.twist, Vector6d(Vector6d::Ones()));
}

TEST(SweepMotion, OfAScanItselfStaysAsItIs) {
  const Trajectory poses{{0, SE3()}, {100000000, SE3(Eigen::Quaterniond::Identity(), {1, 0, 0})}};
  SweepMotion motion(Vector6d::Ones());
  motion.of_scan = true;
  ASSERT_TRUE(MotionThrough(poses, 1, kMaxGapS, &motion));
  EXPECT_EQ(motion.twist, Vector6d::Ones());
  motion.of_scan = false;
  ASSERT_TRUE(MotionThrough(poses, 1, kMaxGapS, &motion));
  EXPECT_NE(motion.twist, Vector6d::Ones());
}

// A sensor that turns to and fro once in two scans. The second scan's motion is found relative to
// that of the first, as if this one had stood still.
TEST(SweepMotion, OfTheFirstOfTwoScansIsHalfOfWhatTheyDifferBy) {
  constexpr double kRate = 10.0 * M_PI, kGapS = 0.1, kAmplitude = 0.026;
  for (const double phase : {0.0, 0.7, 1.5}) {
    const auto at = [&](double t) { return kAmplitude * std::sin(kRate * t + phase); };
    const auto rate = [&](double t) { return kAmplitude * kRate * std::cos(kRate * t + phase); };
    const auto motion = [&](double t) {
      return SweepMotion(rate(t) * Vector6d::Unit(2), -kRate * kRate * at(t) * Vector6d::Unit(2));
    };
    const Vector6d mean = (at(kGapS) - at(0.0)) / kGapS * Vector6d::Unit(2);
    SweepMotion second = motion(kGapS);
    second.twist -= motion(0.0).twist;
    second.acceleration -= motion(0.0).acceleration;
    const SweepMotion first = FirstOfTwo(mean, kGapS, SweepMotion(), second);
    EXPECT_TRUE(first.of_scan);
    EXPECT_NEAR(first.acceleration(2), motion(0.0).acceleration(2), 1e-9) << phase;
    EXPECT_NEAR(first.twist(2), motion(0.0).twist(2), 0.25 * kAmplitude * kRate) << phase;
  }
}

}  // namespace
}  // namespace lamina
