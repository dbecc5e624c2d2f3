#include "tools/export/command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "io/map/trajectory_io.h"
#include "io/points/scan_file.h"

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

  int Run(std::vector<std::string> arguments, bool cloud = true) {
    CLI::App app;
    std::function<int()> run;
    AddExportCommand(&app, &run);
    if (cloud) arguments.insert(arguments.begin(), {"--scans", Path("scans")});
    arguments.insert(arguments.begin(), {"export", "--run", Path("run")});
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
  for (const char* format : {"las", "laz", "copc"}) {
    ASSERT_EQ(Run({"--resolution", "0.5", "--format", format}), 0);
    const std::string name = std::string("run/cloud.") + format;
    const std::string file = Path(format == std::string("copc") ? "run/cloud.copc.laz" : name);
    EXPECT_EQ(ReadScanFile(file, {}).points.size(), 3U) << format;
  }
  ASSERT_EQ(Run({"--resolution", "10", "--out", Path("map.ply")}), 0);
  EXPECT_EQ(ReadScanFile(Path("map.ply"), {}).points.size(), 1U);
  EXPECT_THROW(Run({"--resolution", "1", "--format", "xyz"}), CLI::ParseError);
  ASSERT_EQ(Run({}), 0);
  EXPECT_EQ(ReadScanFile(Path("run/cloud.ply"), {}).points.size(), 4U) << "a point every 0.1 m";
}

TEST_F(ExportCommandTest, LasHasTheStampsOfThePoints) {
  ASSERT_EQ(Run({"--resolution", "0.1", "--format", "las"}), 0);
  std::ifstream file(Path("run/cloud.las"), std::ios::binary);
  const std::string las((std::istreambuf_iterator<char>(file)), {});
  constexpr std::size_t kPoints = 4, kBytes = 30;
  ASSERT_GT(las.size(), kPoints * kBytes);
  for (std::size_t i = 0; i < kPoints; ++i) {
    const char* record = las.data() + las.size() - (kPoints - i) * kBytes;
    double stamp_s = 0.0;
    std::memcpy(&stamp_s, record + 22, sizeof(stamp_s));
    EXPECT_EQ(stamp_s, static_cast<double>(i < 2 ? i : i + 1) + 0.5);
  }
}

TEST_F(ExportCommandTest, TrajectoriesAreTablesAndLinesOfMaps) {
  ASSERT_EQ(Run({"--trajectory", Path("way.csv")}, false), 0);
  std::ifstream csv(Path("way.csv"));
  std::string line, second;
  std::getline(csv, line);
  EXPECT_EQ(line, "stamp_s,x,y,z,qx,qy,qz,qw,piece");
  std::getline(csv, line);
  std::getline(csv, second);
  EXPECT_EQ(second, "1.500000000,0,0.25,0,0,0,0,1,0");
  // With the covariances that the run knows.
  std::ofstream frames(Path("run/frames.csv"));
  frames << "scan,stamp_s,status,cov_rx,cov_ry,cov_rz,cov_x,cov_y,cov_z,piece\n";
  for (int i = 0; i < 5; ++i) {
    frames << i << "," << i << ".500000000," << (i == 2 ? "too few points" : "tracked")
           << ",1e-6,2e-6,3e-6,4e-4,5e-4,6e-4,0\n";
  }
  frames.close();
  ASSERT_EQ(Run({"--trajectory", Path("known.csv")}, false), 0);
  std::ifstream known(Path("known.csv"));
  std::getline(known, line);
  EXPECT_EQ(line, "stamp_s,x,y,z,qx,qy,qz,qw,piece,status,cov_rx,cov_ry,cov_rz,cov_x,cov_y,cov_z");
  std::getline(known, line);
  std::getline(known, second);
  EXPECT_EQ(second, "1.500000000,0,0.25,0,0,0,0,1,0,tracked,1e-6,2e-6,3e-6,4e-4,5e-4,6e-4");
  ASSERT_EQ(Run({"--trajectory", Path("way.geojson")}, false), 0);
  const auto json = nlohmann::json::parse(std::ifstream(Path("way.geojson")));
  EXPECT_EQ(json["type"], "FeatureCollection");
  ASSERT_EQ(json["features"].size(), 1U);
  EXPECT_EQ(json["features"][0]["geometry"]["type"], "LineString");
  EXPECT_EQ(json["features"][0]["geometry"]["coordinates"].size(), 4U);
  EXPECT_EQ(json["features"][0]["geometry"]["coordinates"][3], nlohmann::json({0.0, 1.0, 0.0}));
  EXPECT_EQ(json["features"][0]["properties"]["last_stamp_s"], "4.500000000");
  EXPECT_THROW(Run({"--trajectory", Path("way.kml")}, false), OptionError);
}

TEST_F(ExportCommandTest, ScansThatWereLostAreLeftOut) {
  std::ofstream(Path("run/frames.csv")) << "scan,stamp_s,status,piece\n"
                                           "0,0.500000000,first,0\n"
                                           "1,1.500000000,lost,0\n"
                                           "2,2.500000000,too few points,0\n"
                                           "3,3.500000000,tracked,0\n"
                                           "4,4.500000000,degenerate,0\n";
  ASSERT_EQ(Run({}), 0);
  const Scan cloud = ReadScanFile(Path("run/cloud.ply"), {});
  ASSERT_EQ(cloud.points.size(), 3U);
  for (const ScanPoint& p : cloud.points) EXPECT_NE(p.intensity, 1.0F);
}

TEST_F(ExportCommandTest, APieceOfItsOwnIsWrittenWhereItIsAskedFor) {
  std::ofstream(Path("run/frames.csv")) << "scan,stamp_s,status,piece\n"
                                           "0,0.500000000,first,0\n"
                                           "1,1.500000000,tracked,0\n"
                                           "3,3.500000000,first,2\n"
                                           "4,4.500000000,tracked,2\n";
  ASSERT_EQ(Run({"--piece", "2"}), 0);
  const Scan cloud = ReadScanFile(Path("run/cloud.ply"), {});
  ASSERT_EQ(cloud.points.size(), 2U);
  for (const ScanPoint& p : cloud.points) EXPECT_GE(p.intensity, 3.0F);
  EXPECT_THROW(Run({"--piece", "1"}), InputError);
  std::filesystem::remove(Path("run/frames.csv"));
  EXPECT_THROW(Run({"--drive", "0"}), OptionError) << "nothing tells of drives";
}

// Both drives of a merged map begin at zero.
TEST_F(ExportCommandTest, TheDriveOfAMergedMapIsToldWhereStampsDoNot) {
  Trajectory both;
  std::ofstream frames(Path("run/frames.csv"));
  frames << "scan,stamp_s,status,piece,frame,drive\n";
  for (int drive = 0; drive < 2; ++drive) {
    for (int i = 0; i < 5; ++i) {
      both.push_back({i * StampNs{1000000000} + 500000000,
                      SE3(Eigen::Quaterniond::Identity(), {0.0, 0.25 * i, 10.0 * drive})});
      frames << i << "," << i << ".500000000,tracked,0,0," << drive << "\n";
    }
  }
  frames.close();
  WriteTumTrajectory(Path("run/trajectory_tum.txt"), both);
  try {
    Run({});
    FAIL() << "one of two drives was taken";
  } catch (const OptionError& error) {
    EXPECT_THAT(error.what(), HasSubstr("--drive is needed"));
    EXPECT_THAT(error.what(), HasSubstr("drives 0, 1"));
  }
  ASSERT_EQ(Run({"--drive", "1"}), 0);
  const Scan cloud = ReadScanFile(Path("run/cloud.ply"), {});
  ASSERT_EQ(cloud.points.size(), 5U);
  for (const ScanPoint& p : cloud.points) EXPECT_NEAR(p.z, 10.0, 1e-6);
  EXPECT_THROW(Run({"--drive", "2"}), OptionError);
}

TEST_F(ExportCommandTest, PosesOnANationalGridAreBroughtIntoTheMap) {
  const Eigen::Vector3d grid(500'000.0, 5'400'000.0, 300.0);
  Trajectory poses = ReadTrajectory(Path("run/trajectory_tum.txt"));
  for (StampedPose& pose : poses) pose.T_world_lidar.t += grid;
  WriteTumTrajectory(Path("run/trajectory_tum.txt"), poses);
  EXPECT_THROW(Run({}), InputError) << "all points are too far away";
  EXPECT_FALSE(std::filesystem::exists(Path("run/cloud.ply")));
  std::ofstream(Path("run/summary.json")) << R"({"map_origin_m": [500000.0, 5400000.0, 300.0]})";
  ASSERT_EQ(Run({}), 0);
  const Scan cloud = ReadScanFile(Path("run/cloud.ply"), {});
  ASSERT_EQ(cloud.points.size(), 4U);
  for (const ScanPoint& p : cloud.points) EXPECT_NEAR(p.x, 10.0, 1e-4);
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
