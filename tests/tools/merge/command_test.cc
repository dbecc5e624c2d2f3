#include "tools/merge/command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "tests/support/program/drive_folders.h"

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

class MergeCommand : public DriveFoldersTest {};

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
  testing::internal::CaptureStdout();
  EXPECT_EQ(Merge({first, second, "--out", Path("out")}), 0);
  const std::string said = testing::internal::GetCapturedStdout();
  EXPECT_NE(said.find("2 maps that nothing connects"), std::string::npos) << said;
  EXPECT_NE(said.find("refused      "), std::string::npos) << said;
  EXPECT_EQ(Summary()["frames"].size(), 2U);
  EXPECT_EQ(Summary()["loops"]["accepted"], 0);
  for (const char* name : {"map_surfels_piece1.ply", "trajectory_tum_piece0.txt",
                           "trajectory_tum_piece1.txt", "graph_piece1.g2o"})
    EXPECT_TRUE(std::filesystem::exists(Path(std::string("out/") + name))) << name;
}

TEST_F(MergeCommand, WhatWasMergedIsMergedWithMore) {
  const Town town(1);
  const std::vector<SE3> there = Drive({{-60, -60}, {60, -60}, {60, 60}});
  const std::vector<SE3> back = Drive({{60, 30}, {60, -60}, {-60, -60}});
  const std::vector<SE3> third = Drive({{60, -60}, {60, 60}, {0, 60}});
  const std::string first = MapDrive("first", town, there, 0);
  const std::string second = MapDrive("second", town, back, 1000);
  // Its stamps lie between those of the others.
  const std::string last = MapDrive("last", town, third, 500);
  ASSERT_EQ(Merge({first, second, "--out", Path("two")}), 0);
  ASSERT_EQ(Merge({Path("two"), last, "--out", Path("out")}), 0);
  EXPECT_EQ(Summary()["frames"].size(), 1U);
  std::vector<SE3> both = there;
  both.insert(both.end(), back.begin(), back.end());
  EXPECT_LT(ErrorM("out/trajectory_tum_drive0.txt", there[0], both), 1.0);
  EXPECT_LT(ErrorM("out/trajectory_tum_drive1.txt", there[0], third), 1.0);
  // One of them again.
  EXPECT_THAT(MessageOf<InputError>([&] {
                Merge({Path("two"), second, "--out", Path("twice")});
              }),
              testing::HasSubstr("the same drive is there twice"));
}

TEST_F(MergeCommand, WhatIsNoDriveIsNamed) {
  const std::string drive = MapDrive("drive", Town(1), Drive({{0, 0}, {20, 0}}), 0);
  EXPECT_THAT(MessageOf<InputError>([&] {
                Merge({drive, Path("none"), "--out", Path("out")});
              }),
              testing::HasSubstr("no such folder"));
  Write("empty/frames.csv", "");
  EXPECT_THAT(MessageOf<InputError>([&] {
                Merge({drive, Path("empty"), "--out", Path("out")});
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
