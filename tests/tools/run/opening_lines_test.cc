// What a run says of its recording before it begins, and what it decides by that.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "backend/opening/deskew_choice.h"
#include "core/base/angle.h"
#include "tests/support/program/run_helpers.h"
#include "tests/support/scenes/random_scenes.h"
#include "tests/support/scenes/swept_drive.h"
#include "tools/run/fitting_config.h"
#include "tools/run/opening_lines.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr double kEpochS = 1.7e9;

// Every `step`-th scan of a drive, without times, by a clock that runs so many times as fast.
class Clocked final : public ScanSource {
 public:
  Clocked(std::size_t step, StampNs faster) : step_(step), faster_(faster) {}
  std::size_t size() const override { return LongDrive(false).size() / step_; }
  std::string Name(std::size_t i) const override { return std::to_string(i); }
  StampNs Stamp(std::size_t i) const override {
    return faster_ * LongDrive(false).Stamp(step_ * i);
  }
  Scan Read(std::size_t i) const override {
    Scan scan = LongDrive(false).Read(step_ * i);
    scan.time_s.clear();
    scan.stamp_ns = Stamp(i);
    return scan;
  }

 private:
  std::size_t step_;
  StampNs faster_;
};

class OpeningTest : public RunTest {
 protected:
  // The configuration that all of these scans ask for.
  FittingConfig FitOf(const std::string& folder, const Recording& scans) {
    const auto source = OpenScans(WriteRecording(folder, scans), {});
    return FindFittingConfig(*source, {0, source->size()});
  }
  // Files 1.pcd, 2.pcd, ... in the order of `order`, with readings of a clock.
  std::string WriteClocked(const std::string& folder, bool compensated,
                           const std::function<std::size_t(std::size_t)>& name) const {
    const SweptDrive& drive = LongDrive(compensated);
    for (std::size_t i = 0; i < drive.size(); ++i) {
      Write(folder + "/" + std::to_string(name(i)) + ".pcd",
            TimedPcd(drive.Read(i), kEpochS + 0.1 * static_cast<double>(i)));
    }
    return Path(folder);
  }
};

TEST_F(OpeningTest, ThreeLinesSayWhatWasUnderstood) {
  const Outcome kitti = Run(WriteRecording("street", Street(3)));
  EXPECT_THAT(kitti.err,
              AllOf(HasSubstr("scans   3 files *.bin, in the order of their names; stamps from "
                              "times.txt, 10 Hz"),
                    HasSubstr("no times: each scan is taken as instantaneous"),
                    HasSubstr("sensor  16 rings, -15 to 15 deg up, 360 deg around"),
                    HasSubstr("default options")));
  const std::string scans = WriteClocked("clocked", false, [](std::size_t i) { return i + 1; });
  const Outcome clocked = Run(scans, {"--config", "kitti_raw", "--frames", "0:4"});
  EXPECT_THAT(clocked.err,
              AllOf(HasSubstr("20 files *.pcd"), HasSubstr("stamps from the points' times"),
                    HasSubstr("times by their azimuth"), HasSubstr("configuration kitti_raw")));
  EXPECT_THAT(Run(scans, {"--frames", "0:4"}).err,
              HasSubstr("times in field 'timestamp' in s, readings of a clock, over 0.1"));
}

TEST_F(OpeningTest, ClocksOfThePointsAreStampsAndGiveTheOrder) {
  const std::string in_order = WriteClocked("a", false, [](std::size_t i) { return i + 1; });
  EXPECT_THAT(Run(in_order).err, Not(HasSubstr("order of names")));
  // 5 and 6 have changed places, and so on.
  const std::string mixed = WriteClocked("b", false, [](std::size_t i) { return 1 + (i ^ 1U); });
  const Outcome outcome = Run(mixed, {}, 0, "mixed");
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("in the order of their stamps"),
                                 HasSubstr("2.pcd is 0.100 s before 1.pcd")));
  EXPECT_EQ(Bytes(Path("mixed/trajectory_tum.txt")), Bytes(Path("out/trajectory_tum.txt")));
  EXPECT_NEAR(
      1e-9 * static_cast<double>(ReadTrajectory(Path("out/trajectory_tum.txt")).front().stamp_ns),
      kEpochS, 0.11);
  EXPECT_EQ(Summary("mixed")["lost_frames"], 0);
}

TEST_F(OpeningTest, CompensatedCloudsAreNotDeskewedAgain) {
  const std::string swept = WriteClocked("swept", false, [](std::size_t i) { return i; });
  const std::string still = WriteClocked("still", true, [](std::size_t i) { return i; });
  EXPECT_THAT(Run(swept).err, AllOf(HasSubstr("used to deskew"), Not(HasSubstr("compensated"))));
  EXPECT_THAT(Bytes(Path("out/config.yaml")), HasSubstr("deskew: auto"));
  EXPECT_THAT(Run(still).err, AllOf(HasSubstr("compensated for motion already"),
                                    HasSubstr("not used (preparation.deskew=off)")));
  EXPECT_THAT(Bytes(Path("out/config.yaml")), HasSubstr("deskew: off"));
  // Who says what he wants gets that.
  EXPECT_THAT(Run(still, {"--set", "preparation.deskew=time"}).err, Not(HasSubstr("compensated")));
}

TEST_F(OpeningTest, SweepsWithoutTimesAreDeskewedByAzimuth) {
  const SweptDrive& drive = LongDrive(false);
  for (std::size_t i = 0; i < drive.size(); ++i) {
    Write("points/" + std::to_string(100 + i) + ".bin", KittiBin(drive.Read(i).points));
  }
  const auto off_m = [&] {
    const Trajectory poses = ReadTrajectory(Path("out/trajectory_tum.txt"));
    return (poses.back().T_world_lidar.t - drive.TruePose(drive.size() - 1).t).norm();
  };
  EXPECT_THAT(Run(Path("points")).err,
              AllOf(HasSubstr("sweeps that are not compensated for motion: planes are"),
                    HasSubstr("times by their azimuth"), HasSubstr("rotation=clockwise")));
  EXPECT_THAT(Bytes(Path("out/config.yaml")), HasSubstr("deskew: azimuth"));
  const double deskewed_m = off_m();
  EXPECT_LT(deskewed_m, 0.03);
  EXPECT_THAT(Run(Path("points"), {"--set", "preparation.deskew=off"}).err,
              Not(HasSubstr("compensated")));
  EXPECT_GT(off_m(), 2.0 * deskewed_m);
}

// A drive whose points are in the frame of a vehicle on which the sensor is tilted: no beam is at
// one elevation there.
class Tilted final : public ScanSource {
 public:
  explicit Tilted(bool compensated) : drive_(LongDrive(compensated)) {}
  std::size_t size() const override { return drive_.size(); }
  std::string Name(std::size_t i) const override { return drive_.Name(i); }
  StampNs Stamp(std::size_t i) const override { return drive_.Stamp(i); }
  Scan Read(std::size_t i) const override {
    const Eigen::AngleAxisf tilt(0.15F, Eigen::Vector3f::UnitX());
    Scan scan = drive_.Read(i);
    for (ScanPoint& p : scan.points) {
      const Eigen::Vector3f tilted = tilt * Eigen::Vector3f(p.x, p.y, p.z);
      p = {tilted.x(), tilted.y(), tilted.z(), p.intensity};
    }
    return scan;
  }

 private:
  const SweptDrive& drive_;
};

TEST(DeskewChoice, IsTheThinnerMapsWhereTheSensorMoved) {
  const MappingOptions options;
  const DeskewChoice swept = ChooseDeskew(Tilted(false), 0, 20, options, nullptr);
  EXPECT_EQ(swept.verdict, DeskewChoice::Verdict::kDeskew);
  EXPECT_LT(swept.deskewed_m, swept.as_they_are_m);
  const DeskewChoice still = ChooseDeskew(Tilted(true), 0, 20, options, nullptr);
  EXPECT_EQ(still.verdict, DeskewChoice::Verdict::kCompensated);
  EXPECT_FALSE(still.by_beams);
  EXPECT_LT(still.as_they_are_m, 0.9 * still.deskewed_m);
}

TEST(DeskewChoice, IsThatOfTheBeamsOfASpinningSensor) {
  const MappingOptions options;
  const DeskewChoice swept = ChooseDeskew(LongDrive(false), 0, 20, options, nullptr);
  EXPECT_EQ(swept.verdict, DeskewChoice::Verdict::kDeskew);
  const DeskewChoice still = ChooseDeskew(LongDrive(true), 0, 20, options, nullptr);
  EXPECT_EQ(still.verdict, DeskewChoice::Verdict::kCompensated);
  EXPECT_TRUE(still.by_beams);
  EXPECT_EQ(still.deskewed_m, 0.0) << "no maps were compared";
}

TEST_F(OpeningTest, StampsOutsideOfTheSweepAreNamed) {
  const auto write = [this](const std::string& folder, float shift_s) {
    for (std::size_t i = 0; i < 3; ++i) {
      Scan scan = LongDrive(false).Read(i);
      for (float& t : scan.time_s) t += shift_s;
      Write(folder + "/" + std::to_string(i) + ".pcd", TimedPcd(scan, 0.0));
    }
    Write(folder + "/times.txt", "0\n0.1\n0.2\n");
    return Path(folder);
  };
  const auto opening = [&](const std::string& scans) {
    return Lamina({"run", "--scans", scans, "--out", Path("out")}).err;
  };
  // The drive's stamps are in the middle of the sweep.
  EXPECT_THAT(opening(write("end", -0.05F)),
              AllOf(HasSubstr("-0.100 to -0.000 s from the stamp"), Not(HasSubstr("or when"))));
  EXPECT_THAT(opening(write("sent", -0.09F)),
              HasSubstr("the stamp of the first scan is 0.040 s after all of its points"));
}

TEST_F(OpeningTest, TimesAgainstThePeriodAreNamed) {
  const SweptDrive& drive = LongDrive(false);
  for (std::size_t i = 0; i < 4; ++i) {
    Write("fast/" + std::to_string(i) + ".pcd", TimedPcd(drive.Read(i), 0.0));
  }
  Write("fast/times.txt", "0\n0.05\n0.1\n0.15\n");
  // Deskewed twice too far.
  EXPECT_THAT(Lamina({"run", "--scans", Path("fast"), "--out", Path("out")}).err,
              AllOf(HasSubstr("but scans are 0.050 s apart"), Not(HasSubstr("compensated"))));
  Write("fast/times.txt", "0\n0.1\n0.05\n0.3\n");
  EXPECT_THAT(Run(Path("fast")).err,
              HasSubstr("1 stamps are not after the one before, first that of 2.pcd"));
}

TEST_F(OpeningTest, TimesThatMisleadAreNotUsed) {
  const SweptDrive& drive = LongDrive(false);
  const auto run = [&](double per_s) {
    for (std::size_t i = 0; i < drive.size(); ++i) {
      // With recorded stamps: by made-up ones a sweep is taken to last as long as they are apart.
      const std::int64_t stamp_ns = 1'700'000'000'000'000'000 + 100'000'000 * std::int64_t(i);
      Write("wrong/" + std::to_string(stamp_ns) + ".pcd", TimedPcd(drive.Read(i), 0.0, per_s));
    }
    return Run(Path("wrong"), {"--set", "scans.point_time_unit=s"});
  };
  // Milliseconds as seconds, and a unit that is none of those: each sweep seems to be 100 s or 0.5
  // s long.
  for (const double per_s : {1000.0, 5.0}) {
    const Outcome outcome = run(per_s);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_THAT(outcome.err, AllOf(HasSubstr("times are understood wrongly"),
                                   HasSubstr("scans.point_time_unit tells their unit")))
        << per_s;
    EXPECT_EQ(Summary()["lost_frames"], 0) << per_s;
    EXPECT_THAT(Bytes(Path("out/config.yaml")), HasSubstr("deskew: off"));
  }
  EXPECT_THAT(run(1.0).err, Not(HasSubstr("understood wrongly")));
}

ScanPoint PointAt(double radius_m, double up, double turn) {
  return {static_cast<float>(radius_m * std::cos(up) * std::cos(turn)),
          static_cast<float>(radius_m * std::cos(up) * std::sin(turn)),
          static_cast<float>(radius_m * std::sin(up)), 0.0F};
}

// Scans of a spinning sensor, all of whose points are on a sphere.
// To a share of the directions one ring sees farther.
std::string SphereBin(double radius_m, double farther_share = 0.0) {
  constexpr double kFartherM = 40.0;
  std::vector<ScanPoint> points;
  for (int ring = -8; ring <= 8; ++ring) {
    for (int k = 0; k < 600; ++k) {
      const double up = Radians(2.0 * ring), turn = 2.0 * M_PI * k / 600.0;
      const bool farther = ring == 0 && k < 600.0 * farther_share;
      points.push_back(PointAt(farther ? kFartherM : radius_m, up, turn));
    }
  }
  return KittiBin(points);
}

// Stamps 0.2 s apart are those of each scan of a slow sensor, or of every second one of a fast one.
TEST(SweepPeriodChoice, TellsHalfTheScansFromASlowSensor) {
  MappingOptions options;
  options.preparation.deskew = ScanPreparationOptions::Deskew::kAzimuth;
  const Clocked half(2, 1), slow(1, 2), fast(1, 1);
  const SweepPeriodChoice dropped = ChooseSweepPeriod(half, 0, half.size(), options, nullptr);
  EXPECT_NEAR(dropped.period_s, 0.1, 1e-6);
  EXPECT_LT(dropped.halved_m, 0.9 * dropped.by_stamps_m);
  const SweepPeriodChoice all = ChooseSweepPeriod(slow, 0, slow.size(), options, nullptr);
  EXPECT_EQ(all.period_s, 0.0);
  EXPECT_GT(all.halved_m, all.by_stamps_m);
  EXPECT_EQ(ChooseSweepPeriod(fast, 0, fast.size(), options, nullptr).by_stamps_m, 0.0);
  options.preparation.sweep_period_s = 0.2;
  EXPECT_EQ(ChooseSweepPeriod(half, 0, half.size(), options, nullptr).period_s, 0.0);
}

TEST_F(OpeningTest, ASmallPlaceIsMappedFinerWhereNoConfigurationIsGiven) {
  const std::string room =
      WriteRecording("room", SyntheticRecording(synth::SceneKind::kRoom, 12, 2));
  const Outcome taken = Run(room, {"--set", "map.budget_mb=300"});
  EXPECT_THAT(taken.err, HasSubstr("configuration handheld: a small place, nine points of ten "
                                   "within 5."));
  const std::string config = Bytes(Path("out/config.yaml"));
  EXPECT_THAT(config, AllOf(HasSubstr("root_size_m: 2\n"), HasSubstr("budget_mb: 300\n")));
  // As if it had been asked for.
  const std::string poses = Bytes(Path("out/trajectory_tum.txt"));
  EXPECT_THAT(Run(room, {"--set", "map.budget_mb=300", "--config", "handheld"}).err,
              HasSubstr("configuration handheld\n"));
  EXPECT_EQ(Bytes(Path("out/config.yaml")), config);
  EXPECT_EQ(Bytes(Path("out/trajectory_tum.txt")), poses);

  EXPECT_THAT(Run(room, {"--config", "default"}).err,
              HasSubstr("--config handheld may fit better"));
  EXPECT_THAT(Bytes(Path("out/config.yaml")), HasSubstr("root_size_m: 1.6\n"));
}

TEST_F(OpeningTest, ASmallPlaceOnTheWayCounts) {
  const auto fit = [&](const std::string& folder, const std::vector<double>& radii,
                       double farther_share = 0.0, double first_farther_share = 0.0) {
    Recording scans;
    for (const double r : radii) {
      const double share =
          scans.empty() && first_farther_share > 0.0 ? first_farther_share : farther_share;
      scans.push_back({SphereBin(r, share), 0.1 * static_cast<double>(scans.size())});
    }
    return FitOf(folder, scans);
  };
  EXPECT_EQ(fit("wide", {13, 13, 13, 13, 13, 13}).name, "");
  EXPECT_EQ(fit("into", {13, 13, 13, 13, 13, 5}).name, "handheld");
  EXPECT_EQ(fit("one", {5}).name, "handheld");
  // Lorries about a car leave gaps.
  EXPECT_EQ(fit("lorries", {13, 13, 5, 13, 13, 13}, 0.2).name, "");
  EXPECT_EQ(fit("yard", {13, 13, 5, 5, 13, 13}, 0.2).name, "handheld");
  // On a motorway most of what a wide view meets may be the ground near by and the vehicle itself.
  EXPECT_EQ(fit("motorway", {5, 5, 5, 5, 5, 5}, 0.5).name, "");
  // Where one scan sees so much, others are of the same place, with lorries about.
  EXPECT_EQ(fit("overtaken", {5, 5, 5, 5, 5, 5}, 0.3, 0.5).name, "");
  EXPECT_EQ(fit("indoors", {13, 13, 13, 5, 5, 5}, 0.0, 0.5).name, "handheld");
}

// Points that lie anywhere on a sphere about the sensor, but for what is straight up and down.
std::string SpreadBin(double radius_m, int count) {
  Draws draws(7);
  std::vector<ScanPoint> points;
  for (int i = 0; i < count; ++i) {
    const double up = draws.Uniform(-0.3, 0.9), turn = draws.Uniform(0.0, 2.0 * M_PI);
    points.push_back(PointAt(radius_m, up, turn));
  }
  return KittiBin(points);
}

TEST_F(OpeningTest, FewPointsOnNoRingsAreThoseOfAMid360) {
  const auto fit = [&](const std::string& folder, double radius_m, int count) {
    Recording scans;
    for (int i = 0; i < 6; ++i) scans.push_back({SpreadBin(radius_m, count), 0.1 * i});
    return FitOf(folder, scans);
  };
  EXPECT_EQ(fit("street", 13.0, 15000).name, "livox_mid360");
  EXPECT_TRUE(fit("street", 13.0, 15000).measured);
  EXPECT_EQ(fit("dense", 13.0, 60000).name, "");
  EXPECT_EQ(fit("room", 5.0, 15000).name, "handheld");
}

TEST_F(OpeningTest, ThinnedScansFarApartAreKeyframes) {
  const auto fit = [&](const std::string& folder, std::size_t step, double apart_s) {
    Recording scans = Street(6);
    for (std::size_t i = 0; i < scans.size(); ++i) {
      std::vector<ScanPoint> kept;
      const std::string& all = scans[i].bytes;
      for (std::size_t at = 0; at < all.size(); at += step * sizeof(ScanPoint)) {
        kept.emplace_back();
        std::memcpy(&kept.back(), all.data() + at, sizeof(ScanPoint));
      }
      scans[i] = {KittiBin(kept), apart_s * static_cast<double>(i)};
    }
    return FitOf(folder, scans);
  };
  EXPECT_EQ(fit("keyframes", 7, 0.5).name, "keyframes");
  EXPECT_TRUE(fit("keyframes", 7, 0.5).measured);
  EXPECT_EQ(fit("stream", 7, 0.1).name, "");
  EXPECT_EQ(fit("picked", 1, 0.5).name, "");
}

TEST_F(OpeningTest, ScansThatCannotBeReadTellNothingOfTheConfiguration) {
  Recording scans;
  for (int i = 0; i < 6; ++i) scans.push_back({"torn", 0.1 * i});
  const auto source = OpenScans(WriteRecording("torn", scans), {});
  EXPECT_EQ(FindFittingConfig(*source, {0, source->size()}).name, "");
  EXPECT_EQ(FindFittingConfig(*source, {3, 3}).name, "");
}

TEST(SensorGuess, NarrowViewsAndNoPoints) {
  std::vector<ScanPoint> points;
  for (int i = 0; i < 20000; ++i) {
    const float turn = 0.6F * static_cast<float>(std::sin(0.37 * i));
    const float rise = 0.5F * static_cast<float>(std::sin(0.913 * i));
    points.push_back({20.0F * std::cos(turn), 20.0F * std::sin(turn), 20.0F * rise, 0.0F});
  }
  const SensorGuess guess = GuessSensor(points);
  EXPECT_EQ(guess.rings, 0);
  EXPECT_NEAR(guess.around_deg, 70.0, 6.0);
  EXPECT_NEAR(guess.highest_deg, 26.5, 1.0);
  EXPECT_EQ(GuessSensor({}).points, 0U);
  EXPECT_EQ(GuessSensor({{NAN, 0.0F, 0.0F, 0.0F}}).farthest_m, 0.0);
}

}  // namespace
}  // namespace lamina
