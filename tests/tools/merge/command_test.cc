#include "tools/merge/command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "config/config.h"
#include "core/base/error.h"
#include "io/recording/trajectory_io.h"
#include "tests/support/io_test_files.h"
#include "tests/support/mapped_drives.h"
#include "tools/results/submap_file.h"

namespace lamina {
namespace {

int Merge(std::vector<std::string> arguments) {
  CLI::App app;
  std::function<int()> run;
  AddMergeCommand(&app, &run);
  arguments.insert(arguments.begin(), "merge");
  std::reverse(arguments.begin(), arguments.end());
  app.parse(arguments);
  return run();
}

class MergeCommand : public FilesTest {
 protected:
  // The output folder of a run over a drive that began `start_s` seconds after the first day. Its
  // world is the frame of its first pose, and drifts.
  std::string MapDrive(const std::string& name, const Town& town, const std::vector<SE3>& drive,
                       int start_s) {
    const MappedDrive mapped = lamina::MapDrive(town, drive, static_cast<unsigned>(start_s + 1),
                                                0.0004, 1000000000LL * start_s);
    const LoopClosure& closure = *mapped.loops;
    Trajectory odometry = mapped.odometry;
    LaminaConfig config;
    config.loops = DriveLoopOptions();
    SubmapFrameView view;
    view.graph = closure.graph();
    for (const Submap& submap : closure.submaps()) {
      view.submaps.push_back(&submap);
      view.pieces.push_back(0);
    }
    std::filesystem::create_directories(Path(name));
    WriteSubmaps(Path(name + "/" + kSubmapFileName), {view});
    const AnchorCorrection correction(closure.submaps(), closure.anchors());
    std::string table = "scan,stamp_s,status,piece\n";
    for (std::size_t i = 0; i < odometry.size(); ++i) {
      odometry[i].T_world_lidar =
          correction.Corrected(odometry[i].stamp_ns, odometry[i].T_world_lidar);
      table += std::to_string(i) + ",";
      AppendSeconds(odometry[i].stamp_ns, &table);
      table += ",tracked,0\n";
    }
    WriteTumTrajectory(Path(name + "/trajectory_tum.txt"), odometry);
    Write(name + "/frames.csv", table);
    Write(name + "/config.yaml", ToYaml(config));
    return Path(name);
  }
  nlohmann::json Summary(const std::string& out = "out") const {
    return nlohmann::json::parse(Bytes(Path(out + "/summary.json")));
  }
  // Root mean square of the errors of a drive in the frame whose origin is at this true pose.
  double ErrorM(const std::string& file, const SE3& T_true_frame,
                const std::vector<SE3>& truth) const {
    const Trajectory poses = ReadTrajectory(Path(file));
    EXPECT_EQ(poses.size(), truth.size());
    double square = 0.0;
    for (std::size_t i = 0; i < poses.size(); ++i)
      square += (T_true_frame * poses[i].T_world_lidar.t - truth[i].t).squaredNorm();
    return std::sqrt(square / static_cast<double>(poses.size()));
  }
};

TEST_F(MergeCommand, DrivesOfOneTownBecomeOneMapWhateverTheirOrder) {
  const Town town(1);
  const std::vector<SE3> there = Drive({{-60, -60}, {60, -60}, {60, 60}});
  const std::vector<SE3> back = Drive({{60, 30}, {60, -60}, {-60, -60}});
  const std::string first = MapDrive("first", town, there, 0);
  const std::string second = MapDrive("second", town, back, 1000);
  EXPECT_EQ(Merge({first, second, "--out", Path("out")}), 0);
  const nlohmann::json summary = Summary();
  EXPECT_EQ(summary["frames"].size(), 1U);
  EXPECT_EQ(summary["frames"][0]["drives"], (nlohmann::json{0, 1}));
  EXPECT_GE(summary["loops"]["accepted"], 4);
  EXPECT_LT(ErrorM("out/trajectory_tum_drive0.txt", there[0], there), 1.0);
  EXPECT_LT(ErrorM("out/trajectory_tum_drive1.txt", there[0], back), 1.0);
  EXPECT_EQ(ReadTrajectory(Path("out/trajectory_tum.txt")).size(), there.size() + back.size());
  EXPECT_FALSE(std::filesystem::exists(Path("out/map_surfels_piece1.ply")));

  EXPECT_EQ(Merge({second, first, "--out", Path("other")}), 0);
  for (const char* name : {"map_surfels.ply", "trajectory_tum.txt", "trajectory_tum_drive1.txt",
                           "loops.csv", "graph.g2o", "submaps.bin", "frames.csv"})
    EXPECT_EQ(Bytes(Path(std::string("out/") + name)), Bytes(Path(std::string("other/") + name)))
        << name;
}

TEST_F(MergeCommand, DrivesOfTwoTownsStayTwoMaps) {
  const std::vector<SE3> drive = Drive({{-60, -60}, {60, -60}, {60, 0}});
  const std::string first = MapDrive("first", Town(1), drive, 0);
  const std::string second = MapDrive("second", Town(12), drive, 1000);
  EXPECT_EQ(Merge({first, second, "--out", Path("out")}), 0);
  EXPECT_EQ(Summary()["frames"].size(), 2U);
  EXPECT_EQ(Summary()["loops"]["accepted"], 0);
  for (const char* name : {"map_surfels_piece1.ply", "trajectory_tum_piece0.txt",
                           "trajectory_tum_piece1.txt", "graph_piece1.g2o"})
    EXPECT_TRUE(std::filesystem::exists(Path(std::string("out/") + name))) << name;
}

TEST_F(MergeCommand, WhatIsNoDriveIsNamed) {
  const std::string drive = MapDrive("drive", Town(1), Drive({{0, 0}, {20, 0}}), 0);
  EXPECT_THAT(MessageOf<InputError>([&] {
                Merge({drive, Path("none"), "--out", Path("out")});
              }),
              testing::HasSubstr("--loops on"));
  EXPECT_THROW(Merge({drive, "--out", drive}), OptionError);
  Write("drive/submaps.bin", "LAMINASM");
  EXPECT_THAT(MessageOf<InputError>([&] {
                Merge({drive, "--out", Path("out")});
              }),
              testing::HasSubstr("submaps.bin"));
}

}  // namespace
}  // namespace lamina
