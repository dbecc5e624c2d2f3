#include "tools/eval/command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "io/map/trajectory_io.h"

namespace lamina {
namespace {

using testing::HasSubstr;

class EvalCommandTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        std::filesystem::path(testing::TempDir()) /
        ("eval_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string Path(const std::string& name) const { return (folder_ / name).string(); }

  // Runs the command; what it prints is in output_.
  int Run(std::vector<std::string> arguments) {
    CLI::App app;
    std::function<int()> run;
    AddEvalCommand(&app, &run);
    arguments.insert(arguments.begin(), "eval");
    std::reverse(arguments.begin(), arguments.end());
    app.parse(arguments);
    testing::internal::CaptureStdout();
    try {
      const int code = run();
      output_ = testing::internal::GetCapturedStdout();
      return code;
    } catch (...) {
      output_ = testing::internal::GetCapturedStdout();
      throw;
    }
  }

  // The message of the Error that the command ends with.
  template <typename Error>
  std::string MessageOf(const std::vector<std::string>& arguments) {
    try {
      Run(arguments);
    } catch (const Error& error) {
      return error.what();
    }
    ADD_FAILURE() << "the command succeeded";
    return "";
  }

  std::string Text(const std::string& name) const {
    std::ifstream file(Path(name));
    std::ostringstream text;
    text << file.rdbuf();
    return text.str();
  }

  std::filesystem::path folder_;
  std::string output_;
};

// Along x, a pose each 0.1 s.
Trajectory StraightDrive(int count, double step_m) {
  Trajectory trajectory;
  for (int i = 0; i < count; ++i) {
    trajectory.push_back({i * StampNs{100000000} + 5000000000,
                          SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(i * step_m, 0, 0))});
  }
  return trajectory;
}

TEST_F(EvalCommandTest, ComparesByLineWhereThereAreNoStamps) {
  WriteKittiTrajectory(Path("truth.txt"), StraightDrive(401, 1.0));
  WriteKittiTrajectory(Path("estimate.txt"), StraightDrive(301, 1.02));
  ASSERT_EQ(Run({"--estimate", Path("estimate.txt"), "--truth", Path("truth.txt"), "--align",
                 "first", "--frames", "0:301", "--json", Path("out.json")}),
            0);
  EXPECT_THAT(output_, HasSubstr("matched by line number"));
  EXPECT_THAT(output_, HasSubstr("alignment: first poses made equal"));
  EXPECT_THAT(output_, HasSubstr("mean over all segments of 100..800 m: t_rel 2.0000 %"));
  const nlohmann::json json = nlohmann::json::parse(Text("out.json")).at("truth").at(0);
  EXPECT_EQ(json.at("name"), "estimate");
  EXPECT_EQ(json.at("poses"), 301);
  EXPECT_NEAR(json.at("kitti_trel_percent").get<double>(), 2.0, 1e-9);
  EXPECT_NEAR(json.at("ape_max_m").get<double>(), 6.0, 1e-9);
  EXPECT_EQ(json.at("kitti_segments").at(7).at("segments"), 0);
  EXPECT_TRUE(json.at("kitti_segments").at(7).at("translation_percent").is_null());
}

TEST_F(EvalCommandTest, ComparesByStampWhereThereAreStamps) {
  Trajectory estimate = StraightDrive(100, 1.01);
  estimate.erase(estimate.begin() + 3, estimate.begin() + 13);
  for (StampedPose& pose : estimate) pose.stamp_ns += 4000000;
  WriteTumTrajectory(Path("estimate.txt"), estimate);
  WriteTumTrajectory(Path("truth.txt"), StraightDrive(100, 1.0));
  const std::vector<std::string> arguments{
      "--estimate", Path("estimate.txt"), "--truth", Path("truth.txt"), "--json", Path("out.json")};
  ASSERT_EQ(Run(arguments), 0);
  EXPECT_THAT(output_, HasSubstr("estimate: 90 poses, truth: 100 poses, matched by stamp"));
  EXPECT_THAT(output_, HasSubstr("SE(3), least squares"));
  const nlohmann::json json = nlohmann::json::parse(Text("out.json")).at("truth").at(0);
  EXPECT_EQ(json.at("poses"), 90);
  EXPECT_NEAR(json.at("short_segments").at(1).at("translation_percent").get<double>(), 1.0, 0.11);

  std::vector<std::string> strict = arguments;
  strict.insert(strict.end(), {"--tolerance", "0.003"});
  EXPECT_THAT(MessageOf<InputError>(strict), HasSubstr("0 of its 90 poses match"));
}

TEST_F(EvalCommandTest, RefusesToMatchStampsWithLines) {
  WriteTumTrajectory(Path("estimate.txt"), StraightDrive(10, 1.0));
  WriteKittiTrajectory(Path("truth.txt"), StraightDrive(10, 1.0));
  EXPECT_THAT(
      MessageOf<InputError>({"--estimate", Path("estimate.txt"), "--truth", Path("truth.txt")}),
      HasSubstr("estimate has stamps and the truth has none"));
}

TEST_F(EvalCommandTest, TurnsCameraPosesWithTheCalibration) {
  // The camera looks along the LiDAR's x, as KITTI's does.
  Eigen::Matrix3d R;
  R << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  const SE3 T_camera_lidar(R, Eigen::Vector3d(0.1, -0.2, -0.3));
  Trajectory lidar = StraightDrive(50, 1.0);
  for (size_t i = 0; i < lidar.size(); ++i) {
    lidar[i].T_world_lidar.q = ExpSO3({0.0, 0.0, 0.01 * static_cast<double>(i)});
  }
  WriteKittiTrajectory(Path("lidar.txt"), lidar);
  WriteKittiTrajectory(Path("camera.txt"), CameraToLidar(lidar, T_camera_lidar.Inverse()));
  std::ofstream(Path("calib.txt")) << "P0: 1 2 3\nTr: 0 -1 0 0.1 0 0 -1 -0.2 1 0 0 -0.3\n";
  std::vector<std::string> arguments{"--estimate",       Path("lidar.txt"), "--truth",
                                     Path("camera.txt"), "--align",         "none",
                                     "--json",           Path("out.json")};
  ASSERT_EQ(Run(arguments), 0);
  EXPECT_GT(nlohmann::json::parse(Text("out.json"))["truth"][0]["ape_max_m"], 10.0);
  arguments.insert(arguments.end(), {"--calib", Path("calib.txt")});
  ASSERT_EQ(Run(arguments), 0);
  EXPECT_LT(nlohmann::json::parse(Text("out.json"))["truth"][0]["ape_max_m"], 1e-9);

  std::ofstream(Path("calib.txt")) << "P0: 1 2 3\n";
  EXPECT_THAT(MessageOf<InputError>(arguments), HasSubstr("has no line \"Tr:\""));
  std::ofstream(Path("calib.txt")) << "Tr: 1 0 0 0 0 1 0 zero 0 0 1 0\n";
  EXPECT_THAT(MessageOf<InputError>(arguments), HasSubstr("calib.txt:1"));
}

// A recording of four scans of a plate 0.02 m thick, 10 m ahead.
void WritePlateScans(const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder / "velodyne");
  std::ofstream times(folder / "times.txt");
  for (int i = 0; i < 4; ++i) {
    times << 5.0 + 0.1 * i << "\n";
    std::ofstream file(folder / "velodyne" / (std::to_string(i) + ".bin"), std::ios::binary);
    for (int corner = 0; corner < 8; ++corner) {
      const float p[4] = {10.5F + (corner & 1 ? 0.3F : -0.3F), 0.5F + (corner & 2 ? 0.25F : -0.25F),
                          0.5F + (corner & 4 ? 0.01F : -0.01F), 1.0F};
      file.write(reinterpret_cast<const char*>(p), sizeof(p));
    }
  }
}

TEST_F(EvalCommandTest, JudgesTrajectoriesByTheirMaps) {
  WritePlateScans(folder_ / "scans");
  WriteKittiTrajectory(Path("kitti.txt"), StraightDrive(4, 0.0));
  WriteTumTrajectory(Path("tum.txt"), StraightDrive(4, 0.0));
  ASSERT_EQ(Run({"--estimate", Path("kitti.txt"), "--other", "again=" + Path("tum.txt"), "--truth",
                 Path("tum.txt"), "--scans", Path("scans"), "--json", Path("out.json")}),
            0);
  EXPECT_THAT(output_, HasSubstr("matched by stamp"));
  EXPECT_THAT(output_, HasSubstr("1 voxels that all share"));
  const nlohmann::json json = nlohmann::json::parse(Text("out.json"));
  EXPECT_EQ(json["truth"].size(), 2U);
  EXPECT_EQ(json["map_quality"]["scans"], 4);
  const nlohmann::json& list = json["map_quality"]["trajectories"];
  ASSERT_EQ(list.size(), 2U);
  EXPECT_EQ(list[1]["name"], "again");
  for (const nlohmann::json& q : list) {
    EXPECT_NEAR(q["thickness_mean_mm"].get<double>(), 10.0, 1e-3);
    EXPECT_NEAR(q["common_thickness_mm"].get<double>(), 10.0, 1e-3);
  }
}

TEST_F(EvalCommandTest, ReadsScansAsTheRunDidWhoseTrajectoryIsJudged) {
  WritePlateScans(folder_ / "scans");
  WriteTumTrajectory(Path("tum.txt"), StraightDrive(4, 0.0));
  const std::vector<std::string> eval{"--estimate",  Path("tum.txt"), "--scans",
                                      Path("scans"), "--json",        Path("out.json")};
  const auto thickness_mm = [&] {
    EXPECT_EQ(Run(eval), 0);
    const nlohmann::json json = nlohmann::json::parse(Text("out.json"));
    return json["map_quality"]["trajectories"][0]["thickness_mean_mm"].get<double>();
  };
  const double by_default = thickness_mm();
  std::ofstream(Path("config.yaml")) << "preparation:\n  vertical_correction_deg: 3\n";
  EXPECT_NE(thickness_mm(), by_default);
  // One of another program is no reason to judge nothing.
  std::ofstream(Path("config.yaml")) << "nothing: known\n";
  EXPECT_EQ(thickness_mm(), by_default);
}

TEST_F(EvalCommandTest, OfARunItsTrajectoryIsJudged) {
  WriteTumTrajectory(Path("trajectory_tum.txt"), StraightDrive(4, 0.0));
  EXPECT_EQ(Run({"--estimate", Path(""), "--truth", Path("trajectory_tum.txt")}), 0);
  EXPECT_THAT(MessageOf<InputError>({"--estimate", Path("."), "--truth", Path("none.txt")}),
              HasSubstr("none.txt"));
}

TEST_F(EvalCommandTest, SaysWhatIsMissingOrWrong) {
  WriteTumTrajectory(Path("a.txt"), StraightDrive(10, 1.0));
  const std::string a = Path("a.txt");
  EXPECT_THAT(MessageOf<OptionError>({"--estimate", a}), HasSubstr("--truth, --scans"));
  EXPECT_THAT(MessageOf<OptionError>({"--estimate", a, "--scans", Path(""), "--calib", a}),
              HasSubstr("--calib"));
  EXPECT_THAT(MessageOf<OptionError>({"--estimate", a, "--truth", a, "--set", "x=1"}),
              HasSubstr("--scans"));
  for (const char* other : {"noname", "=file", "name="}) {
    EXPECT_THAT(MessageOf<OptionError>({"--estimate", a, "--truth", a, "--other", other}),
                HasSubstr("must be NAME=FILE"));
  }
  EXPECT_THAT(MessageOf<OptionError>({"--estimate", a, "--truth", a, "--tolerance", "-1"}),
              HasSubstr("-1"));
  EXPECT_THAT(MessageOf<InputError>({"--estimate", Path("none.txt"), "--truth", a}),
              HasSubstr("none.txt"));
  EXPECT_THAT(MessageOf<OutputError>(
                  {"--estimate", a, "--truth", a, "--json", Path("no/such/folder.json")}),
              HasSubstr("folder.json"));
  EXPECT_THROW(Run({"--estimate", a, "--truth", a, "--align", "sim3"}), CLI::ParseError);
  EXPECT_THROW(Run({"--truth", a}), CLI::ParseError);
}

TEST_F(EvalCommandTest, DrawsPictures) {
  if (std::system("gnuplot --version >/dev/null 2>&1") != 0) {
    GTEST_SKIP() << "gnuplot is not installed";
  }
  WriteTumTrajectory(Path("truth.txt"), StraightDrive(50, 1.0));
  WriteTumTrajectory(Path("estimate.txt"), StraightDrive(50, 1.01));
  const std::vector<std::string> arguments{"--estimate", Path("estimate.txt"),
                                           "--truth",    Path("truth.txt"),
                                           "--other",    "it's=" + Path("truth.txt")};
  std::vector<std::string> to_folder = arguments;
  to_folder.insert(to_folder.end(), {"--plot", Path("new/folder/")});
  ASSERT_EQ(Run(to_folder), 0);
  EXPECT_THAT(output_, HasSubstr("wrote " + Path("new/folder/top.svg")));
  EXPECT_THAT(Text("new/folder/top.svg"), HasSubstr("<svg"));
  EXPECT_THAT(Text("new/folder/top.svg"), HasSubstr("it's"));
  EXPECT_THAT(Text("new/folder/error.svg"), HasSubstr("distance along the truth"));
  std::vector<std::string> to_prefix = arguments;
  to_prefix.insert(to_prefix.end(), {"--plot", Path("picture"), "--plot-format", "png"});
  ASSERT_EQ(Run(to_prefix), 0);
  EXPECT_EQ(Text("picture_top.png").substr(1, 3), "PNG");
  EXPECT_EQ(Text("picture_error.png").substr(1, 3), "PNG");
}

}  // namespace
}  // namespace lamina
