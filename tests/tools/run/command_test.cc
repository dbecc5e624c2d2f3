// `lamina run` as its users meet it: exit codes, messages and files.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "io/map/map_io.h"
#include "tests/support/program/run_helpers.h"
#include "tests/support/sanitizers.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::SizeIs;
using testing::StartsWith;

class RunCommandTest : public RunTest {};

TEST_F(RunCommandTest, LeavesAllItsFiles) {
  const std::string scans = WriteRecording("street", Street(12));
  const Outcome outcome = Run(scans, {"--progress", "off"});
  EXPECT_THAT(outcome.out, HasSubstr("12 frames in "));
  EXPECT_THAT(outcome.err, testing::Not(HasSubstr("warning")));
  std::vector<std::string> names;
  for (const auto& file : std::filesystem::directory_iterator(Path("out"))) {
    names.push_back(file.path().filename().string());
  }
  EXPECT_THAT(names,
              testing::UnorderedElementsAre(
                  "config.yaml", "frames.csv", "graph.g2o", "loops.csv", "map_surfels.ply",
                  "submaps.bin", "summary.json", "trajectory_kitti.txt", "trajectory_tum.txt",
                  "trajectory_live_kitti.txt", "trajectory_live_tum.txt",
                  "trajectory_odometry_kitti.txt", "trajectory_odometry_tum.txt"));
  EXPECT_THAT(Lines(Bytes(Path("out/trajectory_kitti.txt"))), SizeIs(12));
  EXPECT_THAT(Bytes(Path("out/map_surfels.ply")), StartsWith("ply\n"));
  const Trajectory tum = ReadTrajectory(Path("out/trajectory_tum.txt"), {});
  ASSERT_THAT(tum, SizeIs(12));
  EXPECT_EQ(tum[11].stamp_ns, 1100000000);
}

TEST_F(RunCommandTest, FrameTableHasALineForEachScan) {
  Run(WriteRecording("street", Street(6)));
  const std::vector<std::string> lines = Lines(Bytes(Path("out/frames.csv")));
  ASSERT_THAT(lines, SizeIs(7));
  EXPECT_EQ(lines[0],
            "scan,stamp_s,status,keyframe,points,clusters,matched,iterations,inlier_share,"
            "residual_m,searched,unobservable_directions,worst_sigma_m,cov_rx,cov_ry,cov_rz,cov_x,"
            "cov_y,cov_z,piece,read_ms,prepare_ms,cluster_ms,odometry_ms,map_ms,solve_ms");
  EXPECT_THAT(lines[1], StartsWith("0,0.000000000,first,1,"));
  const auto columns = std::count(lines[0].begin(), lines[0].end(), ',');
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_THAT(lines[i + 1], StartsWith(std::to_string(i) + ","));
    EXPECT_EQ(std::count(lines[i + 1].begin(), lines[i + 1].end(), ','), columns);
  }
}

// What the program that starts it has in memory is no part of the run's.
TEST_F(RunCommandTest, PeakMemoryIsThatOfTheRunAlone) {
  const std::string scans = WriteRecording("street", Street(2));
  constexpr std::size_t kOurs = kSanitized ? 1'500'000'000 : 400'000'000;
  const std::vector<char> memory(kOurs, 1);
  Run(scans);
  EXPECT_EQ(memory.back(), 1);
  EXPECT_LT(Summary()["peak_rss_bytes"].get<std::size_t>(), kOurs);
}

TEST_F(RunCommandTest, SummaryHasTheFigures) {
  const Recording street = Street(40);
  const std::string scans = WriteRecording("street", street);
  Run(scans, {"--frames", "5:25"});
  const nlohmann::json plain = Summary();
  for (const char* key : {"frames", "wall_s", "cpu_s", "cpu_ms_per_frame", "frames_per_s",
                          "peak_rss_bytes", "map_voxels", "map_bytes", "ba_solves"}) {
    ASSERT_TRUE(plain.contains(key)) << key;
    EXPECT_GT(plain[key], 0) << key;
  }
  EXPECT_EQ(plain["frames"], 20);
  EXPECT_EQ(plain["skipped_scans"], 0);
  EXPECT_EQ(plain["interrupted"], false);
  EXPECT_FALSE(plain.contains("ape_rmse_m"));
}

TEST_F(RunCommandTest, ReportsErrorsAgainstTheTruth) {
  const std::string scans = WriteRecording("street", Street(40));
  SynthOptions options;
  options.frames = 40;
  const SynthSequence sequence(options);  // the path does not depend on the sensor
  Trajectory truth;
  for (std::size_t i = 0; i < 40; ++i) truth.push_back({sequence.Stamp(i), sequence.TruePose(i)});
  WriteKittiTrajectory(Path("truth.txt"), truth);
  const Outcome outcome = Run(scans, {"--truth", Path("truth.txt")});
  EXPECT_THAT(outcome.out, HasSubstr("against the truth: APE 0.0"));
  const nlohmann::json summary = Summary();
  EXPECT_LT(summary["ape_rmse_m"], 0.02);
  EXPECT_LT(summary["rpe_rmse_m"], 0.02);
  // No segment of 100 m in 40 m of driving.
  EXPECT_TRUE(summary.at("kitti_trel_percent").is_null());
  EXPECT_TRUE(summary.at("kitti_rrel_deg_per_m").is_null());
}

TEST_F(RunCommandTest, ABadTruthIsRefusedBeforeTheRun) {
  const std::string scans = WriteRecording("street", Street(4));
  EXPECT_THAT(Run(scans, {"--truth", Path("missing.txt")}, 1).err, HasSubstr("missing.txt"));
  EXPECT_FALSE(std::filesystem::exists(Path("out")));
}

TEST_F(RunCommandTest, EffectiveConfigurationMakesTheSameRun) {
  const std::string scans = WriteRecording("street", Street(15));
  Run(scans, {"--set", "map.root_size_m=1.5", "--set", "backend.window.frames=8", "--set",
              "preparation.min_range_m=3.5"});
  EXPECT_THAT(Bytes(Path("out/config.yaml")), HasSubstr("root_size_m: 1.5"));
  Run(scans, {"--config", Path("out/config.yaml")}, 0, "again");
  for (const char* name : {"config.yaml", "trajectory_kitti.txt", "map_surfels.ply"}) {
    EXPECT_TRUE(Bytes(Path(std::string("out/") + name)) ==
                Bytes(Path(std::string("again/") + name)))
        << name << " differs";
  }
}

TEST_F(RunCommandTest, WritesTheSameBytesAtAnyNumberOfThreads) {
  const std::string scans = WriteRecording("street", Street(30));
  Run(scans, {"--threads", "1"});
  for (const char* threads : {"1", "2", "4", "0"}) {
    Run(scans, {"--threads", threads}, 0, "again");
    for (const char* name : {"trajectory_kitti.txt", "trajectory_tum.txt", "map_surfels.ply"}) {
      EXPECT_TRUE(Bytes(Path(std::string("out/") + name)) ==
                  Bytes(Path(std::string("again/") + name)))
          << name << " differs at --threads " << threads;
    }
  }
}

TEST_F(RunCommandTest, InterruptEndsWithWhatWasProcessed) {
  // Far more scans than are processed before the interrupt arrives. The first one is unusable, and
  // its log line tells that the run is on its way.
  constexpr std::size_t kManyScans = 5000;
  const std::string scans = WriteRepeated("street", Street(1)[0].bytes, kManyScans);
  std::filesystem::remove(scans + "/velodyne/000000.bin");
  Write("street/velodyne/000000.bin", "short");
  const pid_t child = Start({"run", "--scans", scans, "--out", Path("out")});
  while (Bytes(Path("stderr")).find("skipped scan 0") == std::string::npos && IsRunning(child)) {
    std::this_thread::yield();
  }
  ASSERT_EQ(kill(child, SIGINT), 0);
  const Outcome outcome = WaitFor(child);
  EXPECT_EQ(outcome.code, 130) << outcome.err;
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("stopping in good order"), HasSubstr("interrupted: "),
                                 HasSubstr("of 5000 scans were mapped")));
  const nlohmann::json summary = Summary();
  EXPECT_EQ(summary["interrupted"], true);
  EXPECT_LT(summary["frames"], kManyScans - 1);
  EXPECT_THAT(Lines(Bytes(Path("out/trajectory_kitti.txt"))),
              SizeIs(summary["frames"].get<std::size_t>() + 1));
}

TEST_F(RunCommandTest, MapStaysBelowItsBudget) {
  const std::string scans = Path("long");
  ASSERT_EQ(Lamina({"synth", "--out", scans, "--sensor", "vlp16", "--frames", "120", "--route",
                    "straight"})
                .code,
            0);
  Run(scans, {}, 0, "unlimited");
  const auto all = Summary("unlimited")["map_bytes"].get<double>();
  constexpr double kMegabyte = 1048576.0;
  ASSERT_GT(all, 4.5 * kMegabyte) << "the recording is too short to fill a budget";
  Run(scans, {"--set", "map.budget_mb=2.8"});
  EXPECT_LE(Summary()["map_peak_bytes"], 2.8 * kMegabyte);
  EXPECT_EQ(Summary()["map_over_budget"], false);
  EXPECT_EQ(Summary()["lost_frames"], 0);
  // What left memory is in the map that is written.
  EXPECT_GT(Summary()["map_surfels"], 0.9 * Summary("unlimited")["map_surfels"].get<double>());
  EXPECT_LT(LargestDistance(AllScans(), AllScans("unlimited")), 0.01);
  // Less than the frames of the window need: they keep it, and the run says so, once.
  std::filesystem::remove_all(Path("out"));
  const Outcome outcome = Run(scans, {"--set", "map.budget_mb=1.3"});
  std::vector<std::string> warnings;
  for (const std::string& line : Lines(outcome.err)) {
    if (line.find("warning") != std::string::npos) warnings.push_back(line);
  }
  ASSERT_THAT(warnings, SizeIs(1));
  EXPECT_THAT(warnings[0],
              AllOf(HasSubstr("over map.budget_mb=1.3"), HasSubstr("raise the budget")));
  EXPECT_EQ(Summary()["map_over_budget"], true);
  EXPECT_GT(Summary()["map_peak_bytes"], 1.3 * kMegabyte);
  EXPECT_LT(Summary()["map_peak_bytes"], 6.0 * kMegabyte);
  EXPECT_EQ(Summary()["lost_frames"], 0);
  EXPECT_LT(LargestDistance(AllScans(), AllScans("unlimited")), 0.01);
}

struct HelpEntry {
  std::string name, description;
};

// The entries below a heading of a help text. What follows a name too long for its column, and
// descriptions, stand in a column of their own.
std::vector<HelpEntry> HelpEntries(const std::string& help, const std::string& heading) {
  constexpr std::size_t kNameColumn = 2, kDescriptionColumn = 30;
  std::vector<HelpEntry> entries;
  bool inside = false;
  for (const std::string& line : Lines(help)) {
    const std::size_t begin = std::min(line.size(), line.find_first_not_of(' '));
    if (begin == 0) inside = line == heading;
    if (!inside || begin < kNameColumn) continue;
    if (begin == kNameColumn) {
      const std::size_t end = std::min(line.size(), line.find(' ', begin));
      entries.push_back({line.substr(begin, end - begin), ""});
    }
    if (line.size() > kDescriptionColumn && line[kDescriptionColumn - 1] == ' ') {
      entries.back().description += line.substr(kDescriptionColumn);
    }
  }
  return entries;
}

TEST_F(RunCommandTest, HelpExplainsEveryCommandAndOption) {
  const Outcome all = Lamina({"--help"});
  EXPECT_EQ(all.code, 0);
  EXPECT_THAT(all.out,
              HasSubstr("Exit codes: 0 done, 1 failed with a reason, 2 wrong usage, 3 a run "));
  const std::vector<HelpEntry> commands = HelpEntries(all.out, "Subcommands:");
  EXPECT_GE(commands.size(), 5U) << all.out;
  for (const HelpEntry& command : commands) {
    EXPECT_GT(command.description.size(), 20U) << command.name;
    const Outcome outcome = Lamina({command.name, "--help"});
    EXPECT_EQ(outcome.code, 0) << command.name;
    const std::vector<HelpEntry> options = HelpEntries(outcome.out, "Options:");
    EXPECT_GE(options.size(), 2U) << outcome.out;
    for (const HelpEntry& option : options) {
      EXPECT_THAT(option.name, StartsWith("-")) << command.name;
      EXPECT_GT(option.description.size(), 15U) << command.name << " " << option.name;
    }
  }
}

TEST_F(RunCommandTest, WrongUsageIsExitCodeTwo) {
  EXPECT_EQ(Lamina({}).code, 2);
  EXPECT_EQ(Lamina({"walk"}).code, 2);
  EXPECT_EQ(Lamina({"run"}).code, 2);
  const std::vector<std::string> run{"run", "--scans", Path("x"), "--out", Path("out")};
  for (const std::vector<std::string>& more : std::vector<std::vector<std::string>>{
           {"--nonsense"}, {"--threads", "many"}, {"--threads", "-1"}, {"--progress", "maybe"}}) {
    std::vector<std::string> arguments = run;
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Outcome outcome = Lamina(arguments);
    EXPECT_EQ(outcome.code, 2) << more[0];
    EXPECT_THAT(outcome.err, HasSubstr(more[0]));
  }
  EXPECT_FALSE(std::filesystem::exists(Path("out")));
}

TEST_F(RunCommandTest, ValuesAgainstTheirRulesAreWrongUsageOfEveryCommand) {
  Write("run/trajectory_tum.txt", "0 0 0 0 0 0 0 1\n0.1 0 0 0 0 0 0 1\n");
  Write("run/config.yaml", "");
  const Eigen::Vector3f z = Eigen::Vector3f::UnitZ();
  WriteSurfels(Path("run/map_surfels.ply"), {{Eigen::Vector3d::Zero(), z, z, 1}});
  const std::string run = Path("run"), poses = Path("run/trajectory_tum.txt");
  const std::string scans = WriteRecording("street", Street(2));
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"eval", "--estimate", poses},
           {"eval", "--estimate", poses, "--truth", poses, "--tolerance", "-1"},
           {"eval", "--estimate", poses, "--truth", poses, "--other", "nameless"},
           {"eval", "--estimate", poses, "--scans", scans, "--set", "map.depth=9"},
           {"export", "--run", run, "--scans", scans, "--resolution", "0"},
           {"export", "--run", run, "--scans", scans, "--resolution", "1", "--out", Path("m.xyz")},
           {"plot", "--run", run, "--out", Path("map.jpg")},
           {"synth", "--out", Path("synth"), "--scene", "moon"},
           {"synth", "--out", Path("synth"), "--frames", "0"}}) {
    const Outcome outcome = Lamina(arguments);
    EXPECT_EQ(outcome.code, 2) << testing::PrintToString(arguments) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr("error: "));
  }
}

// The recordings that no test can make: taken with real sensors.
class RecordingTest : public RunTest {
 protected:
  // Maps one of them, folder `name` of $LAMINA_RECORDINGS. False if it is not there: to be skipped.
  bool RunOn(const std::string& name, const std::string& config) {
    const char* recordings = std::getenv("LAMINA_RECORDINGS");
    if (recordings == nullptr || !std::filesystem::exists(recordings + ("/" + name))) return false;
    const std::string scans = std::string(recordings) + "/" + name;
    std::vector<std::string> options{"--config",
                                     std::string(LAMINA_SOURCE_DIR) + "/config/" + config};
    if (std::filesystem::exists(scans + "/poses_reference.txt")) {
      options.insert(options.end(), {"--truth", scans + "/poses_reference.txt"});
    }
    Run(scans, options);
    return true;
  }
};

constexpr char kNoRecording[] =
    "set LAMINA_RECORDINGS to a folder with the recording of this test to run it";

TEST_F(RecordingTest, KittiRawDrive) {
  if (!RunOn("kitti_raw_0005_first70", "kitti_raw.yaml")) GTEST_SKIP() << kNoRecording;
  EXPECT_LE(Summary()["ape_rmse_m"], 0.007);
  EXPECT_EQ(Summary()["lost_frames"], 0);
  EXPECT_EQ(Summary()["frames"], 70);
}

TEST_F(RecordingTest, HandHeldNarrowView) {
  if (!RunOn("hku1_avia", "livox_avia.yaml")) GTEST_SKIP() << kNoRecording;
  EXPECT_LE(Summary()["ape_rmse_m"], 0.12);
  EXPECT_EQ(Summary()["lost_frames"], 0);
  const Trajectory poses = AllScans();
  ASSERT_THAT(poses, SizeIs(314));
  // The way ends where it began.
  EXPECT_LE((poses.back().T_world_lidar.t - poses.front().T_world_lidar.t).norm(), 0.08);
}

TEST_F(RecordingTest, WalkWithSolidStateSensor) {
  if (!RunOn("balm_realworld_first20", "livox_avia.yaml")) GTEST_SKIP() << kNoRecording;
  EXPECT_EQ(Summary()["lost_frames"], 0);
  EXPECT_EQ(Summary()["frames"], 20);
}

}  // namespace
}  // namespace lamina
