#include "tools/synth/sequence.h"
#include "core/base/angle.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "io/map/trajectory_io.h"
#include "tools/synth/command.h"
#include "tools/synth/writer.h"

namespace lamina {
namespace {

using synth::SceneKind;
using synth::SensorKind;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

namespace fs = std::filesystem;

SynthOptions Options(SceneKind scene, SensorKind sensor) {
  SynthOptions options;
  options.scene = scene;
  options.sensor = sensor;
  options.sweep = true;
  return options;
}

std::string Bytes(const Scan& scan) {
  std::string bytes(reinterpret_cast<const char*>(scan.points.data()),
                    scan.points.size() * sizeof(ScanPoint));
  bytes.append(reinterpret_cast<const char*>(scan.time_s.data()),
               scan.time_s.size() * sizeof(float));
  return bytes;
}

Eigen::Vector3d PositionOf(const ScanPoint& p) {
  return Eigen::Vector3f(p.x, p.y, p.z).cast<double>();
}

// Distances of every `stride`-th point to the true surfaces. Points are taken to the world by the
// pose at their own time, or, if not `deskewed`, at the stamp.
std::vector<double> SurfaceDistances(const SynthSequence& sequence, std::size_t frame,
                                     bool deskewed, std::size_t stride) {
  const Scan scan = sequence.Generate(frame);
  const double stamp_s = SecondsBetween(0, scan.stamp_ns);
  const auto view = sequence.ViewAround(sequence.TruePose(frame).t, 200.0);
  std::vector<double> distances;
  for (std::size_t i = 0; i < scan.points.size(); i += stride) {
    const double t = stamp_s + (deskewed && !scan.time_s.empty() ? scan.time_s[i] : 0.0);
    const Eigen::Vector3d p_world = sequence.TruePoseAt(t) * PositionOf(scan.points[i]);
    distances.push_back(view.SurfaceDistance(sequence.T_scene_world() * p_world, 2.0));
  }
  return distances;
}

double ShareAbove(const std::vector<double>& values, double limit) {
  const auto above =
      std::count_if(values.begin(), values.end(), [&](double v) { return v > limit; });
  return static_cast<double>(above) / static_cast<double>(values.size());
}

struct Setup {
  SceneKind scene;
  SensorKind sensor;
};

class SynthSetups : public ::testing::TestWithParam<Setup> {};

TEST_P(SynthSetups, NoiseFreePointsLieOnTheSurfaces) {
  SynthOptions options = Options(GetParam().scene, GetParam().sensor);
  options.noise_m = 0.0;
  const SynthSequence sequence(options);
  for (const std::size_t frame : {std::size_t{0}, std::size_t{61}}) {
    const std::vector<double> distances = SurfaceDistances(sequence, frame, true, 7);
    EXPECT_LT(ShareAbove(distances, 2e-3), 2e-4);
    EXPECT_EQ(ShareAbove(distances, 0.05), 0.0);
  }
}

TEST_P(SynthSetups, MostRaysReturnWithinTheSensorsRange) {
  const SynthSequence sequence(Options(GetParam().scene, GetParam().sensor));
  const synth::SensorModel& sensor = sequence.sensor();
  const Scan scan = sequence.Generate(33);
  const std::size_t rays = sensor.groups() * sensor.rays_per_group();
  EXPECT_GT(scan.points.size(), rays / 3);
  EXPECT_LE(scan.points.size(), rays);
  EXPECT_EQ(scan.time_s.size(), scan.points.size());
  for (const ScanPoint& p : scan.points) {
    const double range = PositionOf(p).norm();
    EXPECT_GT(range, sensor.min_range_m() - 0.15);
    EXPECT_LT(range, sensor.max_range_m() + 0.15);
    EXPECT_TRUE(p.intensity >= 0.0F && p.intensity <= 1.0F) << p.intensity;
  }
}

std::vector<Setup> AllSetups() {
  std::vector<Setup> setups;
  for (int scene = 0; scene < static_cast<int>(SceneKind::kBays); ++scene) {
    for (int sensor = 0; sensor < static_cast<int>(synth::SensorNames().size()); ++sensor) {
      setups.push_back({static_cast<SceneKind>(scene), static_cast<SensorKind>(sensor)});
    }
  }
  for (const SceneKind scene :
       {SceneKind::kBays, SceneKind::kField, SceneKind::kTunnel, SceneKind::kForest}) {
    setups.push_back({scene, SensorKind::kSpinning});
  }
  return setups;
}

INSTANTIATE_TEST_SUITE_P(All, SynthSetups, ::testing::ValuesIn(AllSetups()), [](const auto& p) {
  return synth::SceneNames()[static_cast<std::size_t>(p.param.scene)] + "_" +
         synth::SensorNames()[static_cast<std::size_t>(p.param.sensor)];
});

TEST(SynthSequence, NoiseHasTheGivenSize) {
  SynthOptions options = Options(SceneKind::kRoom, SensorKind::kOs1);
  options.noise_m = 0.02;
  const SynthSequence noisy(options);
  options.noise_m = 0.0;
  const SynthSequence exact(options);
  const Scan a = noisy.Generate(12);
  const Scan b = exact.Generate(12);
  ASSERT_EQ(a.points.size(), b.points.size());
  double sum = 0.0;
  double square = 0.0;
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    const double error = PositionOf(a.points[i]).norm() - PositionOf(b.points[i]).norm();
    sum += error;
    square += error * error;
  }
  const auto n = static_cast<double>(a.points.size());
  EXPECT_NEAR(sum / n, 0.0, 5.0 * 0.02 / std::sqrt(n));
  EXPECT_NEAR(std::sqrt(square / n), 0.02, 0.001);
  const std::vector<double> distances = SurfaceDistances(noisy, 12, true, 1);
  EXPECT_LT(ShareAbove(distances, 0.06), 0.003);
}

TEST(SynthSequence, SweptPointsNeedTheirOwnTime) {
  for (const SensorKind sensor : {SensorKind::kHdl64, SensorKind::kAvia, SensorKind::kMid360}) {
    const bool street = sensor == SensorKind::kHdl64;
    SynthOptions options = Options(street ? SceneKind::kStreet : SceneKind::kRoom, sensor);
    options.noise_m = 0.0;
    const SynthSequence sequence(options);
    EXPECT_LT(ShareAbove(SurfaceDistances(sequence, 20, true, 5), 0.02), 1e-4);
    EXPECT_GT(ShareAbove(SurfaceDistances(sequence, 20, false, 5), 0.02), 0.05);
  }
}

TEST(SynthSequence, TimeOfASpinningSensorFollowsFromTheAzimuth) {
  const SynthSequence sequence(Options(SceneKind::kStreet, SensorKind::kHdl64));
  const Scan scan = sequence.Generate(3);
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const ScanPoint& p = scan.points[i];
    const double fraction = 0.5 * (1.0 - std::atan2(p.y, p.x) / M_PI);
    EXPECT_NEAR(scan.time_s[i], 0.1 * (fraction - 0.5), 1e-6);
  }
}

TEST(SynthSequence, WithoutSweepScansAreInstantaneous) {
  SynthOptions options = Options(SceneKind::kStreet, SensorKind::kVlp16);
  options.sweep = false;
  options.noise_m = 0.0;
  const SynthSequence sequence(options);
  EXPECT_TRUE(sequence.Generate(5).time_s.empty());
  EXPECT_LT(ShareAbove(SurfaceDistances(sequence, 5, false, 3), 2e-3), 2e-4);
}

TEST(SynthSequence, FirstPoseIsTheIdentityAndStampsAreTenthsOfSeconds) {
  const SynthSequence sequence(Options(SceneKind::kHall, SensorKind::kVlp16));
  EXPECT_EQ(sequence.TruePose(0).t, Eigen::Vector3d::Zero());
  EXPECT_EQ(sequence.TruePose(0).q.coeffs(), Eigen::Quaterniond::Identity().coeffs());
  EXPECT_LT(sequence.TruePoseAt(0.0).t.norm(), 1e-12);
  EXPECT_EQ(sequence.Stamp(7), 700000000);
}

TEST(SynthSequence, SameBytesAtAnyNumberOfThreadsAndInAnyOrder) {
  SynthOptions options = Options(SceneKind::kStreet, SensorKind::kHdl64);
  options.movers = 10;
  std::vector<std::string> one, two;
  {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    const SynthSequence sequence(options);
    for (const std::size_t i : {0, 30, 60}) one.push_back(Bytes(sequence.Generate(i)));
  }
  const SynthSequence sequence(options);
  for (const std::size_t i : {60, 30, 0}) two.insert(two.begin(), Bytes(sequence.Generate(i)));
  EXPECT_EQ(one, two);
  options.seed = 2;
  EXPECT_NE(Bytes(SynthSequence(options).Generate(0)), one[0]);
}

TEST(SynthSequence, MirrorSeesAllAroundAndFillsItsGaps) {
  const synth::SensorModel sensor(SensorKind::kMid360);
  const auto cells = [&](int scans) {
    std::set<std::pair<int, int>> seen;  // of 3 x 3 deg
    std::vector<Eigen::Vector3d> directions;
    for (int frame = 0; frame < scans; ++frame) {
      for (std::size_t group = 0; group < sensor.groups(); ++group) {
        sensor.Directions(frame, group, &directions);
        for (const Eigen::Vector3d& d : directions) {
          const double up = Degrees(std::asin(d.z()));
          EXPECT_TRUE(up > -7.01 && up < 52.01) << up;
          const double around = Degrees(std::atan2(d.y(), d.x()));
          seen.emplace(static_cast<int>(std::floor(around / 3)), static_cast<int>(up + 9) / 3);
        }
      }
    }
    return seen.size();
  };
  const std::size_t one = cells(1), ten = cells(10);
  EXPECT_LT(one, 120U * 20U * 9U / 10U);
  EXPECT_GT(ten, 120U * 20U * 98U / 100U);
  EXPECT_EQ(sensor.TimeOf(0, 0), 0.0);
}

TEST(SynthSequence, RosetteDoesNotRepeat) {
  const synth::SensorModel sensor(SensorKind::kAvia);
  std::vector<Eigen::Vector3d> first, second;
  sensor.Directions(0, 100, &first);
  sensor.Directions(1, 100, &second);
  EXPECT_GT((first[0] - second[0]).norm(), 0.01);
  double widest = 0.0;
  double highest = 0.0;
  for (std::size_t group = 0; group < sensor.groups(); ++group) {
    sensor.Directions(5, group, &first);
    for (const Eigen::Vector3d& d : first) {
      widest = std::max(widest, std::abs(std::atan2(d.y(), d.x())));
      highest = std::max(highest, std::abs(std::asin(d.z())));
    }
  }
  EXPECT_NEAR(Degrees(widest), 35.2, 0.3);
  EXPECT_NEAR(Degrees(highest), 38.6, 0.3);
}

TEST(SynthSequence, MoversAreSeenAndMove) {
  SynthOptions options = Options(SceneKind::kStreet, SensorKind::kHdl64);
  EXPECT_LT(ShareAbove(SurfaceDistances(SynthSequence(options), 40, true, 5), 0.3), 1e-5);
  options.movers = 12;
  EXPECT_GT(ShareAbove(SurfaceDistances(SynthSequence(options), 40, true, 5), 0.3), 1e-3);
}

TEST(SynthSequence, LoopReturnsToTheSameGeometry) {
  SynthOptions options = Options(SceneKind::kStreet, SensorKind::kVlp16);
  options.route = synth::RouteKind::kLoop;
  options.loop_blocks = 1;
  options.frames = 2000;
  const SynthSequence sequence(options);
  double nearest = 1e9;
  for (std::size_t i = 300; i < 1000; ++i) {
    nearest = std::min(nearest, (sequence.TruePose(i).t - sequence.TruePose(10).t).norm());
  }
  EXPECT_LT(nearest, 1.0);
}

TEST(SynthSequence, MemoryDoesNotGrowWithTheWay) {
  SynthOptions options = Options(SceneKind::kStreet, SensorKind::kVlp16);
  options.frames = 20000;
  const SynthSequence sequence(options);
  for (std::size_t i = 0; i < sequence.size(); i += 400) {
    EXPECT_GT(sequence.Generate(i).points.size(), 9000u);
    EXPECT_LE(sequence.cached_blocks(), 64u);
  }
  EXPECT_GT(sequence.TruePose(19999).t.norm(), 3000.0);
}

TEST(SynthSequence, BadOptionsAreNamedWithValueAndRule) {
  const auto make = [](auto change) {
    return [change] {
      SynthOptions options;
      change(&options);
      SynthSequence sequence(options);
    };
  };
  EXPECT_THAT(make([](SynthOptions* o) { o->frames = 0; }),
              ThrowsMessage<OptionError>(AllOf(HasSubstr("frames = 0"), HasSubstr("[1,"))));
  EXPECT_THAT(make([](SynthOptions* o) { o->noise_m = -0.1; }),
              ThrowsMessage<OptionError>(AllOf(HasSubstr("noise_m = -0.1"), HasSubstr("[0,"))));
  EXPECT_THAT(make([](SynthOptions* o) { o->speed_m_per_s = std::nan(""); }),
              ThrowsMessage<OptionError>(HasSubstr("speed_m_per_s")));
  EXPECT_THAT(make([](SynthOptions* o) { o->movers = -1; }),
              ThrowsMessage<OptionError>(HasSubstr("movers = -1")));
}

class SynthOnDisk : public ::testing::Test {
 protected:
  SynthOnDisk() {
    std::string pattern = (fs::temp_directory_path() / "lamina_synth_XXXXXX").string();
    if (::mkdtemp(pattern.data()) == nullptr) throw OutputError(pattern);
    directory_ = pattern;
  }
  ~SynthOnDisk() override { fs::remove_all(directory_); }

  static std::string Content(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }

  // The exit code of `lamina synth ...`; exceptions come through.
  int Run(const std::string& arguments) const {
    CLI::App app("lamina");
    std::function<int()> run;
    AddSynthCommand(&app, &run);
    app.parse("synth " + arguments, false);
    return run();
  }

  fs::path directory_;
};

TEST_F(SynthOnDisk, WritesWhatItGenerates) {
  SynthOptions options = Options(SceneKind::kStreet, SensorKind::kVlp16);
  options.frames = 11;
  std::size_t last_done = 0;
  const WrittenSequence written = WriteSequence(
      options, directory_.string(), [&](std::size_t done, std::size_t) { last_done = done; });
  EXPECT_EQ(written.frames, 11u);
  EXPECT_EQ(last_done, 11u);
  const SynthSequence sequence(options);
  std::vector<StampNs> stamps;
  std::size_t points = 0;
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    Scan scan = sequence.Generate(i);
    points += scan.points.size();
    scan.time_s.clear();
    const std::string name = "velodyne/0000" + std::string(i < 10 ? "0" : "") + std::to_string(i);
    EXPECT_EQ(Content(directory_ / (name + ".bin")), Bytes(scan)) << name;
    stamps.push_back(sequence.Stamp(i));
  }
  EXPECT_EQ(written.points, points);
  const Trajectory truth = ReadTrajectory(written.truth_path, stamps);
  ASSERT_EQ(truth.size(), sequence.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    EXPECT_LT(LocalDelta(truth[i].T_world_lidar, sequence.TruePose(i)).norm(), 1e-12);
  }
  EXPECT_EQ(Content(directory_ / "times.txt").substr(0, 24), "0.000000000\n0.100000000\n");
  EXPECT_THAT(Content(directory_ / "calib.txt"), HasSubstr("Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n"));
}

TEST_F(SynthOnDisk, UntimedScansHaveNoTimes) {
  const std::string out = "--scene room --sensor vlp16 --frames 2 --out " + directory_.string();
  EXPECT_EQ(Run(out), 0);
  EXPECT_TRUE(std::filesystem::exists(directory_ / "times.txt"));
  EXPECT_EQ(Run(out + " --untimed"), 0);
  EXPECT_FALSE(std::filesystem::exists(directory_ / "times.txt"));
}

TEST_F(SynthOnDisk, RefusesToLeaveScansOfALongerSequence) {
  const std::string out = "--scene room --sensor vlp16 --out " + directory_.string();
  EXPECT_EQ(Run(out + " --frames 4"), 0);
  EXPECT_EQ(Run(out + " --frames 4 --seed 3 --threads 2"), 0);
  EXPECT_THAT([&] { Run(out + " --frames 2"); },
              ThrowsMessage<OutputError>(AllOf(HasSubstr("velodyne"), HasSubstr("000002.bin"))));
}

TEST_F(SynthOnDisk, CommandNamesBadValues) {
  const std::string out = "--out " + directory_.string();
  EXPECT_THAT([&] { Run(out + " --scene moon"); },
              ThrowsMessage<OptionError>(AllOf(HasSubstr("moon"), HasSubstr("corridor"))));
  EXPECT_THAT([&] { Run(out + " --sensor radar"); },
              ThrowsMessage<OptionError>(AllOf(HasSubstr("radar"), HasSubstr("hdl64"))));
  EXPECT_THAT([&] { Run(out + " --frames 0"); },
              ThrowsMessage<OptionError>(HasSubstr("frames = 0")));
  EXPECT_THAT([&] { Run(out + " --threads -3"); },
              ThrowsMessage<OptionError>(HasSubstr("--threads = -3")));
  EXPECT_THROW(Run("--frames 3"), CLI::ParseError);
  std::ofstream(directory_ / "file") << "in the way";
  EXPECT_THAT([&] { Run(out + "/file --frames 1"); },
              ThrowsMessage<OutputError>(HasSubstr("file/velodyne")));
}

TEST(SynthScanSource, HandsOutTheScans) {
  SynthOptions options = Options(SceneKind::kRoom, SensorKind::kAvia);
  options.frames = 3;
  const auto sequence = std::make_shared<const SynthSequence>(options);
  const SynthScanSource source(sequence);
  EXPECT_EQ(source.size(), 3u);
  EXPECT_EQ(source.Stamp(2), 200000000);
  EXPECT_EQ(source.Name(2), "synthetic scan 2");
  EXPECT_EQ(Bytes(source.Read(1)), Bytes(sequence->Generate(1)));
}

}  // namespace
}  // namespace lamina
