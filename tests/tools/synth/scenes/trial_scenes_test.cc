// What makes a generated recording hard: profiles of motion, gaps, errors of the sensor.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "core/base/angle.h"
#include "core/base/error.h"
#include "tools/synth/sequence.h"

namespace lamina {
namespace {

using synth::ProfileKind;
using synth::SceneKind;
using synth::SensorKind;

SynthOptions Bays(int points = 2000) {
  SynthOptions options;
  options.scene = SceneKind::kBays;
  options.sensor = SensorKind::kSpinning;
  options.points = points;
  options.noise_m = 0.0;
  return options;
}

SynthOptions Bays(ProfileKind profile) {
  SynthOptions options = Bays();
  options.profile.kind = profile;
  return options;
}

Eigen::Vector3d Velocity(const SynthSequence& sequence, double t) {
  return (sequence.TruePoseAt(t + 1e-4).t - sequence.TruePoseAt(t - 1e-4).t) / 2e-4;
}

Eigen::Vector3d Position(const ScanPoint& p) { return {p.x, p.y, p.z}; }

TEST(SynthProfile, StartsFromRestWithThreeMetresPerSecondSquared) {
  const SynthSequence sequence(Bays(ProfileKind::kStart));
  EXPECT_LT(Velocity(sequence, -0.05).norm(), 1e-9);
  for (const double t : {1.0, 2.5, 4.0}) EXPECT_NEAR(Velocity(sequence, t).norm(), 3.0 * t, 0.1);
  EXPECT_NEAR(Velocity(sequence, 8.0).norm(), 15.0, 0.2);
}

TEST(SynthProfile, MayStandBeforeItStartsAndLeanForward) {
  SynthOptions options = Bays(ProfileKind::kStart);
  options.profile.rest_s = 2.0;
  options.profile.lean_deg = 30.0;
  const SynthSequence sequence(options);
  EXPECT_LT(Velocity(sequence, 1.9).norm(), 1e-9);
  EXPECT_NEAR(Velocity(sequence, 4.0).norm(), 6.0, 0.1);
  // The world is the frame of the first scan, whose x axis points 30 degrees down.
  const Eigen::Vector3d ahead(std::cos(M_PI / 6.0), 0.0, 0.5);
  EXPECT_LT((Velocity(sequence, 4.0).normalized() - ahead).norm(), 0.02);
}

TEST(SynthProfile, BrakesAtEightMetresPerSecondSquaredAndGoesOn) {
  const SynthSequence sequence(Bays(ProfileKind::kBrake));
  double hardest = 0.0, slowest = 15.0, after_rest = 0.0;
  Eigen::Vector3d before = Velocity(sequence, 0.5);
  EXPECT_NEAR(before.norm(), 15.0, 0.2);
  for (double t = 0.6; t < 20.0; t += 0.1) {
    const Eigen::Vector3d now = Velocity(sequence, t);
    EXPECT_LT((now - before).norm(), 0.1 * 8.3) << t;
    hardest = std::max(hardest, before.x() - now.x());
    slowest = std::min(slowest, now.norm());
    if (slowest < 1e-3) after_rest = std::max(after_rest, now.norm());
    before = now;
  }
  EXPECT_NEAR(hardest, 0.8, 0.03);
  EXPECT_LT(slowest, 1e-6);
  EXPECT_NEAR(after_rest, 15.0, 0.2);
}

TEST(SynthProfile, GapsLeaveTrueStampsAndPoses) {
  SynthOptions options = Bays(ProfileKind::kGaps);
  options.frames = 200;
  const SynthSequence sequence(options);
  int gaps = 0;
  for (std::size_t i = 1; i < sequence.size(); ++i) {
    const double step = SecondsBetween(sequence.Stamp(i - 1), sequence.Stamp(i));
    if (step > 0.1001) {
      ++gaps;
      EXPECT_GT(step, 0.59);
      EXPECT_LT(step, 3.11);
    }
    EXPECT_NEAR((sequence.TruePose(i).t - sequence.TruePose(i - 1).t).norm(), 15.0 * step, 0.1);
  }
  EXPECT_GE(gaps, 4);
  EXPECT_LE(gaps, 10);
  options.profile.gap_s = 2.0;
  const SynthSequence given(options);
  std::set<StampNs> steps;
  for (std::size_t i = 1; i < given.size(); ++i) steps.insert(given.Stamp(i) - given.Stamp(i - 1));
  EXPECT_EQ(steps, (std::set<StampNs>{100000000, 2100000000}));
}

TEST(SynthProfile, PickedScansAreOneToFiveMetresApart) {
  SynthOptions options = Bays(ProfileKind::kPicked);
  options.frames = 60;
  const SynthSequence sequence(options);
  double shortest = 100.0, longest = 0.0;
  for (std::size_t i = 1; i < sequence.size(); ++i) {
    const double way = (sequence.TruePose(i).t - sequence.TruePose(i - 1).t).norm();
    EXPECT_NEAR(way, 15.0 * SecondsBetween(sequence.Stamp(i - 1), sequence.Stamp(i)), 0.1);
    shortest = std::min(shortest, way);
    longest = std::max(longest, way);
  }
  // Whole scans, of 1.5 m each.
  EXPECT_NEAR(shortest, 1.5, 0.1);
  EXPECT_NEAR(longest, 4.5, 0.1);
}

TEST(SynthProfile, UntimedScansHaveMadeUpStampsAndTheSamePoints) {
  SynthOptions options = Bays(ProfileKind::kPicked);
  options.frames = 5;
  const SynthScanSource timed(std::make_shared<const SynthSequence>(options));
  options.untimed = true;
  const SynthScanSource untimed(std::make_shared<const SynthSequence>(options));
  EXPECT_TRUE(timed.recorded_stamps());
  EXPECT_FALSE(untimed.recorded_stamps());
  EXPECT_FALSE(timed.Read(3).stamp_made_up);
  EXPECT_TRUE(untimed.Read(3).stamp_made_up);
  EXPECT_EQ(untimed.Read(3).stamp_ns, 300000000);
  EXPECT_NE(timed.Read(3).stamp_ns, 300000000);
  EXPECT_EQ(timed.Read(3).points.size(), untimed.Read(3).points.size());
}

TEST(SynthProfile, SpinsByTheGivenAngleAndNods) {
  const SynthSequence sequence(Bays(ProfileKind::kSpin));
  double lowest = 1.0;
  for (std::size_t i = 10; i < 99; ++i) {
    const SE3 step = sequence.TruePose(i).Inverse() * sequence.TruePose(i + 1);
    EXPECT_NEAR(Degrees(step.q.angularDistance(Eigen::Quaterniond::Identity())), 20.0, 4.0);
    lowest = std::min(lowest, sequence.TruePose(i).R()(2, 2));
  }
  EXPECT_NEAR(Degrees(std::acos(lowest)), 8.0, 1.0);
}

TEST(SynthProfile, ShakesAtFiveHertz) {
  const SynthSequence sequence(Bays(ProfileKind::kShake));
  int turns = 0;
  double before = 0.0, slope = 0.0;
  for (double t = 0.0; t < 4.0; t += 0.01) {
    const double pitch = std::asin(sequence.TruePoseAt(t).R()(2, 0));
    if ((pitch - before) * slope < 0.0) ++turns;
    if (pitch != before) slope = pitch - before;
    before = pitch;
  }
  EXPECT_NEAR(turns, 40, 4);  // two a period
}

TEST(SynthSensor, HasTheRaysAndRingsAskedFor) {
  for (const int points : {2000, 60000, 250000}) {
    for (const int rings : {16, 128}) {
      SynthOptions options = Bays(points);
      options.rings = rings;
      const SynthSequence sequence(options);
      const auto rays =
          static_cast<double>(sequence.sensor().groups() * sequence.sensor().rays_per_group());
      EXPECT_NEAR(rays, points, rings);
      EXPECT_EQ(sequence.sensor().rays_per_group(), static_cast<std::size_t>(rings));
      EXPECT_GT(static_cast<double>(sequence.Generate(3).points.size()), 0.5 * rays);
    }
  }
  SynthOptions options = Bays();
  options.sensor = SensorKind::kHdl64;
  EXPECT_NEAR(static_cast<double>(SynthSequence(options).sensor().groups()), 2000 / 64.0, 0.6);
  options.rings = 32;
  EXPECT_THAT([&] { SynthSequence sequence(options); },
              ::testing::ThrowsMessage<OptionError>(::testing::AllOf(
                  ::testing::HasSubstr("rings = 32"), ::testing::HasSubstr("hdl64"))));
}

TEST(SynthSensorErrors, MoveBeamsAndRangesAndLeaveTheTruth) {
  SynthOptions options = Bays(20000);
  const SynthSequence ideal(options);
  options.errors.beam_elevation_offset_deg = 0.5;
  const SynthSequence tilted(options);
  EXPECT_EQ(tilted.TruePose(40).t, ideal.TruePose(40).t);
  // Rays that point higher than reported meet the ground farther away: it seems to lie lower.
  const auto lowest = [](const Scan& scan) {
    double z = 0.0;
    for (const ScanPoint& p : scan.points) {
      if (Position(p).norm() < 8.0) z = std::min(z, static_cast<double>(p.z));
    }
    return z;
  };
  EXPECT_NEAR(lowest(ideal.Generate(5)), -1.73, 0.1);
  EXPECT_NEAR(lowest(tilted.Generate(5)), lowest(ideal.Generate(5)) - 0.07, 0.03);

  options.errors = {};
  options.errors.beam_range_sigma_m = 0.05;
  const Scan biased = SynthSequence(options).Generate(5);
  const Scan exact = ideal.Generate(5);
  ASSERT_EQ(biased.points.size(), exact.points.size());
  double squares = 0.0;
  std::set<int> different;  // in 0.1 mm
  for (std::size_t i = 0; i < exact.points.size(); ++i) {
    const double bias = Position(biased.points[i]).norm() - Position(exact.points[i]).norm();
    squares += bias * bias;
    different.insert(static_cast<int>(std::lround(1e4 * bias)));
  }
  EXPECT_NEAR(std::sqrt(squares / static_cast<double>(exact.points.size())), 0.05, 0.02);
  EXPECT_LE(different.size(), 128u);  // one for each of 64 beams, rounded
  EXPECT_GE(different.size(), 30u);
}

TEST(SynthSensorErrors, PacketsAreDroppedWhole) {
  SynthOptions options = Bays(20000);
  const std::size_t all = SynthSequence(options).Generate(7).points.size();
  options.errors.dropped_packets = 0.3;
  const SynthSequence sequence(options);
  double share = 0.0;
  for (std::size_t i = 0; i < 10; ++i) {
    share +=
        0.1 * static_cast<double>(sequence.Generate(i).points.size()) / static_cast<double>(all);
  }
  EXPECT_NEAR(share, 0.7, 0.1);
}

TEST(SynthSensorErrors, TimesAreReportedOff) {
  SynthOptions options = Bays();
  options.sweep = true;
  const Scan exact = SynthSequence(options).Generate(2);
  options.errors.time_offset_s = 0.01;
  const Scan late = SynthSequence(options).Generate(2);
  ASSERT_EQ(late.points.size(), exact.points.size());
  for (std::size_t i = 0; i < exact.points.size(); ++i) {
    EXPECT_EQ(late.points[i].x, exact.points[i].x);
    EXPECT_NEAR(late.time_s[i], exact.time_s[i] + 0.01F, 1e-6);
  }
}

SynthOptions InScene(SceneKind scene) {
  SynthOptions options = Bays(10000);
  options.scene = scene;
  return options;
}

// Share of a scan's points that are not on what stands still.
double ShareOff(const SynthSequence& sequence, std::size_t frame) {
  const Scan scan = sequence.Generate(frame);
  const SE3 T_scene_lidar = sequence.T_scene_world() * sequence.TruePose(frame);
  const synth::SceneView view = sequence.ViewAround(sequence.TruePose(frame).t, 130.0);
  int off = 0;
  for (const ScanPoint& p : scan.points) {
    off += view.SurfaceDistance(T_scene_lidar * Position(p), 0.2) > 0.02 ? 1 : 0;
  }
  return off / static_cast<double>(scan.points.size());
}

struct MovingShare {
  SceneKind scene;
  double least, most;
};

class SynthMovingShare : public ::testing::TestWithParam<MovingShare> {};

TEST_P(SynthMovingShare, IsThatOfTheScene) {
  const SynthSequence sequence(InScene(GetParam().scene));
  double share = 0.0;
  for (const std::size_t frame : {0, 20, 40, 60, 80}) share += 0.2 * ShareOff(sequence, frame);
  EXPECT_GE(share, GetParam().least);
  EXPECT_LE(share, GetParam().most);
}

INSTANTIATE_TEST_SUITE_P(All, SynthMovingShare,
                         ::testing::Values(MovingShare{SceneKind::kBays, 0.0, 0.0},
                                           MovingShare{SceneKind::kLorry, 0.15, 0.4},
                                           MovingShare{SceneKind::kCarPark, 0.35, 0.45},
                                           MovingShare{SceneKind::kPavement, 0.02, 0.15},
                                           MovingShare{SceneKind::kLift, 0.1, 0.35}),
                         [](const auto& p) {
                           return synth::SceneNames()[static_cast<std::size_t>(p.param.scene)];
                         });

// What a pane mirrors seems to be behind it, where nothing is.
TEST(SynthScenes, PanesLetPassMirrorAndReturn) {
  const SynthSequence sequence(InScene(SceneKind::kGlass));
  const Scan scan = sequence.Generate(4);
  const SE3 T_scene_lidar = sequence.T_scene_world() * sequence.TruePose(4);
  int on_pane = 0, behind = 0;
  for (const ScanPoint& p : scan.points) {
    const double left = (T_scene_lidar * Position(p)).y() - T_scene_lidar.t.y();
    on_pane += std::abs(left - 1.5) < 0.05 ? 1 : 0;
    behind += left > 1.6 ? 1 : 0;
  }
  EXPECT_GT(on_pane, 200);
  EXPECT_GT(behind, 3 * on_pane / 2);
  EXPECT_GT(ShareOff(sequence, 4), 0.03);
}

TEST(SynthWeather, SprayIsNoiseAndRainIsSome) {
  SynthOptions options = Bays(10000);
  options.weather.spray_first = 3;
  options.weather.spray_scans = 2;
  options.weather.rain = 0.05;
  const SynthSequence sequence(options);
  for (std::size_t i = 1; i < 7; ++i) {
    const Scan scan = sequence.Generate(i);
    double farthest = 0.0;
    for (const ScanPoint& p : scan.points) farthest = std::max(farthest, Position(p).norm());
    if (i == 3 || i == 4) {
      EXPECT_LT(farthest, 8.01);
      EXPECT_GT(ShareOff(sequence, i), 0.9);
    } else {
      EXPECT_GT(farthest, 50.0);
      EXPECT_NEAR(ShareOff(sequence, i), 0.035, 0.02);
    }
  }
}

}  // namespace
}  // namespace lamina
