#include "tools/export/command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "io/recording/scan_source.h"
#include "io/recording/trajectory_io.h"

namespace lamina {
namespace {

using testing::HasSubstr;

// A recording of five scans with one point each, and a run that has skipped the third.
class ExportCommandTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        std::filesystem::path(testing::TempDir()) /
        ("export_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    std::filesystem::create_directories(folder_ / "scans" / "velodyne");
    std::filesystem::create_directories(folder_ / "run");
    std::ofstream(Path("run/config.yaml")) << "# all defaults\n";
    std::ofstream times(Path("scans/times.txt"));
    Trajectory trajectory;
    for (int i = 0; i < 5; ++i) {
      times << i << ".5\n";
      const float p[4] = {10.0F, 0.0F, 0.0F, static_cast<float>(i)};
      std::ofstream file(Path("scans/velodyne/" + std::to_string(i) + ".bin"), std::ios::binary);
      file.write(reinterpret_cast<const char*>(p), sizeof(p));
      if (i == 2) continue;
      trajectory.push_back(
          {i * StampNs{1000000000} + 500000000,
           SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.0, 0.25 * i, 0.0))});
    }
    WriteTumTrajectory(Path("run/trajectory_tum.txt"), trajectory);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string Path(const std::string& name) const { return (folder_ / name).string(); }

  int Run(std::vector<std::string> arguments) {
    CLI::App app;
    std::function<int()> run;
    AddExportCommand(&app, &run);
    arguments.insert(arguments.begin(), {"export", "--run", Path("run"), "--scans", Path("scans")});
    std::reverse(arguments.begin(), arguments.end());
    app.parse(arguments);
    return run();
  }

  std::filesystem::path folder_;
};

TEST_F(ExportCommandTest, WritesThePointsOfThePosedScans) {
  ASSERT_EQ(Run({"--resolution", "0.1"}), 0);
  const Scan cloud = ReadScanFile(Path("run/cloud.ply"), {});
  ASSERT_EQ(cloud.points.size(), 4U);
  for (const ScanPoint& p : cloud.points) {
    EXPECT_NE(p.intensity, 2.0F);
    EXPECT_NEAR(p.x, 10.0, 1e-6);
    EXPECT_NEAR(p.y, 0.25 * static_cast<double>(p.intensity), 1e-6);
  }
}

TEST_F(ExportCommandTest, FormatAndPathCanBeChosen) {
  ASSERT_EQ(Run({"--resolution", "0.5", "--format", "pcd"}), 0);
  EXPECT_EQ(ReadScanFile(Path("run/cloud.pcd"), {}).points.size(), 3U);
  ASSERT_EQ(Run({"--resolution", "10", "--out", Path("map.ply")}), 0);
  EXPECT_EQ(ReadScanFile(Path("map.ply"), {}).points.size(), 1U);
  EXPECT_THROW(Run({"--resolution", "1", "--format", "las"}), CLI::ParseError);
  EXPECT_THROW(Run({}), CLI::ParseError);
}

TEST_F(ExportCommandTest, SaysWhatIsWrongAndLeavesNothing) {
  EXPECT_THROW(Run({"--resolution", "0"}), OptionError);
  EXPECT_THROW(Run({"--resolution", "1", "--out", Path("no/such/map.ply")}), OutputError);
  std::ofstream(Path("scans/times.txt")) << "100\n101\n102\n103\n104\n";
  try {
    Run({"--resolution", "1"});
    FAIL() << "scans of another time were accepted";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("none of its 4 poses"));
  }
  std::filesystem::remove(Path("run/trajectory_tum.txt"));
  EXPECT_THROW(Run({"--resolution", "1"}), InputError);
  for (const auto& entry : std::filesystem::directory_iterator(folder_ / "run")) {
    EXPECT_EQ(entry.path().filename(), "config.yaml");
  }
}

}  // namespace
}  // namespace lamina
