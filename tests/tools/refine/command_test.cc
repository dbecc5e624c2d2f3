#include "tools/refine/command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "tests/support/program/drive_folders.h"

namespace lamina {
namespace {

int Refine(std::vector<std::string> arguments) {
  CLI::App app;
  std::function<int()> run;
  AddRefineCommand(&app, &run);
  arguments.insert(arguments.begin(), "refine");
  std::reverse(arguments.begin(), arguments.end());
  app.parse(arguments);
  return run();
}

class RefineCommand : public DriveFoldersTest {};

TEST_F(RefineCommand, WhatOverlapsIsComparedAndThePosesAreNearerToTheTruth) {
  const Town town(1);
  // Round the block and once more along two of its sides, the other way.
  const std::vector<SE3> drive =
      Drive({{0, 0}, {60, 0}, {60, 60}, {0, 60}, {0, 0}, {-20, 0}, {60, 0}, {60, 40}});
  const std::string run = MapDrive("run", town, drive, 0, 0.0006, false);
  const double before = ErrorM("run/trajectory_tum.txt", drive[0], drive);
  ASSERT_EQ(Refine({"--session", run, "--out", Path("out")}), 0);
  EXPECT_GE(Summary()["loops"]["accepted"], 2);
  EXPECT_LT(ErrorM("out/trajectory_tum.txt", drive[0], drive), std::min(0.3, before));
  EXPECT_FALSE(std::filesystem::exists(Path("out.partial")));
  EXPECT_FALSE(std::filesystem::exists(Path("out.progress")));
  for (const char* name : {"submaps.bin", "map_surfels.ply", "loops.csv", "graph.g2o"})
    EXPECT_TRUE(std::filesystem::exists(Path(std::string("out/") + name))) << name;
  // Once more there is nothing left to do.
  ASSERT_EQ(Refine({"--session", Path("out"), "--out", Path("again/")}), 0);
  EXPECT_EQ(Summary("again")["loops"]["accepted"], 0);
}

TEST_F(RefineCommand, KilledAndCalledAgainItGoesOnToTheSameBytes) {
  const Town town(1);
  const std::vector<SE3> drive =
      Drive({{0, 0}, {60, 0}, {60, 60}, {0, 60}, {0, 0}, {-20, 0}, {60, 0}, {60, 40}});
  const std::string run = MapDrive("run", town, drive, 0, 0.0006, false);
  ASSERT_EQ(Refine({"--session", run, "--out", Path("whole")}), 0);
  const std::string out = Path("out"), progress = Path("out.progress");
  const pid_t child = fork();
  if (child == 0) {
    execl(LAMINA_PROGRAM, LAMINA_PROGRAM, "refine", "--session", run.c_str(), "--out", out.c_str(),
          static_cast<char*>(nullptr));
    _exit(127);
  }
  // Until there is a result in it.
  constexpr std::uintmax_t kHead = 12;
  std::error_code none;
  const auto size = [&] {
    const std::uintmax_t bytes = std::filesystem::file_size(progress, none);
    return none ? 0 : bytes;
  };
  for (int i = 0; i < 60000 && size() <= kHead && !std::filesystem::exists(out); ++i) usleep(1000);
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  ASSERT_FALSE(std::filesystem::exists(out));
  ASSERT_GT(size(), kHead);
  ASSERT_EQ(Refine({"--session", run, "--out", out}), 0);
  for (const char* name : {"trajectory_tum.txt", "submaps.bin", "loops.csv", "map_surfels.ply"})
    EXPECT_EQ(Bytes(out + "/" + name), Bytes(Path(std::string("whole/") + name))) << name;
  EXPECT_FALSE(std::filesystem::exists(progress));
}

TEST_F(RefineCommand, NothingIsWrittenOverAndWhatIsNoMapIsNamed) {
  const std::string run = MapDrive("run", Town(1), Drive({{0, 0}, {60, 0}}), 0);
  const std::string before = Bytes(Path("run/trajectory_tum.txt"));
  EXPECT_THROW(Refine({"--session", run, "--out", run}), OptionError);
  EXPECT_EQ(Bytes(Path("run/trajectory_tum.txt")), before);
  EXPECT_THAT(MessageOf<InputError>([&] {
                Refine({"--session", Path("none"), "--out", Path("out")});
              }),
              testing::HasSubstr("no such folder"));
  EXPECT_FALSE(std::filesystem::exists(Path("out")));
}

}  // namespace
}  // namespace lamina
