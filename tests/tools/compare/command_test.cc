// lamina compare: the whole of it on small scenes, reuse of rows, and what it refuses.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "io/map/trajectory_io.h"
#include "tests/support/program/run_helpers.h"
#include "tools/compare/methods.h"
#include "tools/compare/structure.h"
#include "tools/synth/writer.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;
namespace fs = std::filesystem;

class CompareTest : public RunTest {
 protected:
  // A few coarse scans of a stairwell, in the layout of the ETHZ data set.
  std::string WriteStairs(int scans = 4) const {
    return WriteScene(StationScene::kStairs, scans, 60, 4);
  }

  std::string WriteScene(StationScene scene, int scans, int lines, int ray_step) const {
    StationOptions options;
    options.scene = scene;
    options.scans = scans;
    options.lines = lines;
    options.ray_step = ray_step;
    WriteStations(options, StationLayout::kEthz, Path("scans"));
    return Path("scans");
  }

  Outcome Compare(const std::string& methods, std::vector<std::string> more = {}, int code = 0,
                  const std::string& initial = "truth+noise") const {
    std::vector<std::string> arguments{
        "compare",   "--scans",   Path("scans"), "--truth",   Path("scans/pose_scanner_leica.csv"),
        "--out",     Path("out"), "--methods",   methods,     "--progress",
        "off",       "--jobs",    "1",           "--initial", initial,
        "--noise-m", "0.02",      "--noise-deg", "0.5"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    Outcome outcome = Lamina(arguments);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    return outcome;
  }

  nlohmann::json Row(const std::string& method) const {
    const auto table = nlohmann::json::parse(Bytes(Path("out/table.json")));
    for (const auto& row : table["rows"]) {
      if (row["method"] == method) return row;
    }
    ADD_FAILURE() << "no row of " << method;
    return {};
  }

  // Takes all but so many points from scan 1.
  void CutScan(std::size_t points) const {
    const std::vector<std::string> lines = Lines(Bytes(Path("scans/Hokuyo_1.csv")));
    std::string text;
    for (std::size_t i = 0; i <= points; ++i) text += lines[i] + "\n";
    Write("scans/Hokuyo_1.csv", text);
  }
};

TEST_F(CompareTest, TheQuickSuiteRunsEveryMethodAndShowsThePapersPicture) {
  // Of NDT, which takes longest, few points.
  const Outcome outcome =
      Lamina({"compare", "--suite", "ethz-like", "--quick", "--out", Path("out"), "--progress",
              "off", "--heat-maps", "condensed", "--set", "pairwise.ndt_source_voxel_m=0.8"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const auto table = nlohmann::json::parse(Bytes(Path("out/table.json")));
  EXPECT_EQ(table["rows"].size(), 2 * CompareMethods().size());
  const auto ape = [&](const char* method) {
    EXPECT_TRUE(table["means"].contains(method)) << method << outcome.err;
    return table["means"][method]["ape_cm"].get<double>();
  };
  EXPECT_LT(ape("f2m_vgicp"), 20.0);
  EXPECT_LT(ape("condensed"), ape("f2m_vgicp"));
  EXPECT_LT(ape("condensed"), ape("f2m_icp_plane"));
  EXPECT_LT(ape("condensed"), 1.0);
  EXPECT_LE(ape("huang"), 1.05 * ape("evm1"));
  const std::string markdown = Bytes(Path("out/table.md"));
  EXPECT_THAT(markdown, AllOf(HasSubstr("Synthetic"), HasSubstr("| Lamina (condensed) |"),
                              HasSubstr("**"), HasSubstr("<u>"), HasSubstr("structural error")));
  const std::string csv = Bytes(Path("out/table.csv"));
  EXPECT_EQ(Lines(csv).size(), 1 + 2 * CompareMethods().size());
  // A name with a comma in it is one field.
  EXPECT_THAT(csv, HasSubstr(",sync_fgr,\"global, synchronised\","));
  for (const char* picture : {"structural_error.png", "hauptgebaeude_condensed_heat.png",
                              "gazebo_winter_condensed_heat.png"}) {
    EXPECT_THAT(Bytes(Path(std::string("out/") + picture)).substr(1, 3), "PNG") << picture;
  }
  EXPECT_THAT(Bytes(Path("out/gazebo_winter_condensed_heat.ply")),
              HasSubstr("property float error"));
  EXPECT_FALSE(fs::exists(Path("out/data/gazebo_winter")));
}

TEST_F(CompareTest, FinishedRowsAreReusedAndOthersMadeAnew) {
  WriteStairs();
  Compare("vgicp,condensed");
  const std::string row = Path("out/rows/sequence/condensed.json");
  const std::string other = Path("out/rows/sequence/f2m_vgicp.json");
  // Marks that only a row that is not made again keeps.
  auto json = nlohmann::json::parse(Bytes(row));
  json["cpu_s"] = 1234.5;
  Write("out/rows/sequence/condensed.json", json.dump());
  const std::string table = Bytes(Path("out/table.csv"));
  fs::remove(other);
  Compare("vgicp,condensed");
  EXPECT_EQ(Row("condensed")["cpu_s"], 1234.5);
  EXPECT_TRUE(fs::exists(other));
  Compare("vgicp,condensed", {"--set", "registration.rounds=3"});
  EXPECT_LT(Row("condensed")["cpu_s"], 1234.0);
}

TEST_F(CompareTest, CancelledHalfWayKeepsWhatIsFinished) {
  WriteStairs();
  Compare("condensed");
  const std::string finished = Bytes(Path("out/rows/sequence/condensed.json"));
  // ndt is at work when its row's task file is there.
  const pid_t child = Start({"compare",
                             "--scans",
                             Path("scans"),
                             "--truth",
                             Path("scans/pose_scanner_leica.csv"),
                             "--out",
                             Path("out"),
                             "--methods",
                             "ndt,condensed",
                             "--progress",
                             "off",
                             "--jobs",
                             "1",
                             "--initial",
                             "truth+noise",
                             "--noise-m",
                             "0.02",
                             "--noise-deg",
                             "0.5",
                             "--set",
                             "pairwise.max_iterations=10000",
                             "--set",
                             "pairwise.min_translation_step_m=0"});
  const std::string task = Path("out/rows/sequence/f2f_ndt.json.task");
  while (!fs::exists(task) && IsRunning(child)) usleep(1000);
  kill(child, SIGINT);
  const Outcome outcome = WaitFor(child);
  EXPECT_EQ(outcome.code, 130);
  EXPECT_THAT(outcome.err, HasSubstr("interrupted: the rows that are finished stay"));
  EXPECT_FALSE(fs::exists(Path("out/rows/sequence/f2f_ndt.json")));
  EXPECT_FALSE(fs::exists(task));
  EXPECT_EQ(Bytes(Path("out/rows/sequence/condensed.json")), finished);
}

TEST_F(CompareTest, AMethodBeyondItsTimeLimitFailsAndTheOthersGoOn) {
  WriteStairs();
  const Outcome outcome = Compare("ndt", {"--time-limit", "0.01"});
  EXPECT_THAT(outcome.err, HasSubstr("the time limit of 0.01 s was reached"));
  EXPECT_FALSE(Row("f2m_ndt")["good"].get<bool>());
  EXPECT_FALSE(Row("f2m_ndt").contains("ape_cm"));
  EXPECT_THAT(Bytes(Path("out/table.md")), HasSubstr("failed"));
  Compare("ndt");  // more time: the failed rows are no longer good enough
  EXPECT_TRUE(Row("f2f_ndt")["good"].get<bool>());
}

// What the study compares are times, which no test can hold fast; but all else must be alike.
TEST_F(CompareTest, TheResolutionStudyPosesTheSameProblemAtEachResolution) {
  WriteScene(StationScene::kHauptgebaeude, 4, 300, 2);
  Compare("condensed", {"--resolution-study"});
  const std::vector<std::string> lines = Lines(Bytes(Path("out/resolution.csv")));
  ASSERT_EQ(lines.size(), 1U + 5 * 4) << "a curve has failed";
  EXPECT_EQ(lines[0], "curve,resolution_m,ape_cm,solve_ms,planes,iterations");
  std::map<std::string, std::vector<std::vector<double>>> curves;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    const std::size_t end = lines[i].rfind('"');
    std::istringstream numbers(lines[i].substr(end + 2));
    std::vector<double> values;
    for (std::string cell; std::getline(numbers, cell, ',');) values.push_back(std::stod(cell));
    curves[lines[i].substr(1, end - 1)].push_back(values);
  }
  ASSERT_EQ(curves.size(), 5U);
  const double most_planes = curves.at("condensed, to convergence")[0][3];
  EXPECT_GT(most_planes, 200.0);
  for (const auto& [curve, points] : curves) {
    for (const std::vector<double>& point : points) {
      EXPECT_LT(point[1], 2.0) << curve << " at " << point[0];
      EXPECT_GT(point[3], 0.5 * most_planes) << curve << " at " << point[0];
      EXPECT_LE(point[3], 1.2 * most_planes) << curve << " at " << point[0];
    }
  }
  EXPECT_THAT(Bytes(Path("out/resolution.png")).substr(1, 3), "PNG");
  // Solve times would differ, were anything made again.
  const std::string before = Bytes(Path("out/resolution.csv"));
  Compare("condensed", {"--resolution-study"});
  EXPECT_EQ(Bytes(Path("out/resolution.csv")), before);
}

TEST_F(CompareTest, ATruthOfAnotherLengthIsRefused) {
  WriteStairs();
  const std::vector<std::string> lines = Lines(Bytes(Path("scans/pose_scanner_leica.csv")));
  std::string text;
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) text += lines[i] + "\n";
  Write("scans/pose_scanner_leica.csv", text);
  EXPECT_THAT(Compare("condensed", {}, 1).err,
              HasSubstr("pose_scanner_leica.csv: holds 3 poses for 4 scans"));
}

TEST_F(CompareTest, InitialPosesOfAnotherLengthAreRefused) {
  WriteStairs();
  const std::string path = Write("start.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n");
  EXPECT_THAT(Compare("condensed", {}, 1, path).err,
              HasSubstr("start.txt: holds 1 poses for 4 scans"));
}

TEST_F(CompareTest, AScanOfFewPointsFailsEachMethodWithItsName) {
  WriteStairs();
  CutScan(60);
  Compare("vgicp,teaser,condensed");
  for (const char* method : {"f2f_vgicp", "f2m_vgicp", "teaser", "condensed"}) {
    EXPECT_FALSE(Row(method)["good"].get<bool>()) << method;
    EXPECT_THAT(Row(method)["reason"].get<std::string>(), HasSubstr("scan 1: ")) << method;
  }
}

TEST_F(CompareTest, ScansWithoutOverlapFailEachMethod) {
  WriteStairs(3);
  // Scan 2 is of another place, far from the others by all that is known.
  StationOptions options;
  options.scene = StationScene::kPlain;
  options.scans = 2;
  options.lines = 60;
  options.ray_step = 4;
  WriteStations(options, StationLayout::kEthz, Path("plain"));
  fs::copy_file(Path("plain/Hokuyo_1.csv"), Path("scans/Hokuyo_2.csv"),
                fs::copy_options::overwrite_existing);
  Trajectory start = ReadTrajectory(Path("scans/pose_scanner_leica.csv"));
  start[2].T_world_lidar.t.x() += 500.0;
  WriteKittiTrajectory(Path("start.txt"), start);
  Compare("icp_point,vgicp,teaser,fgr,condensed", {}, 0, Path("start.txt"));
  for (const char* method : {"f2f_icp_point", "f2m_vgicp", "teaser", "fgr", "condensed"}) {
    EXPECT_FALSE(Row(method)["good"].get<bool>()) << method;
    EXPECT_NE(Row(method)["reason"], "") << method;
  }
}

TEST_F(CompareTest, FeatureMethodsSayThatAPlaneIsNotEnough) {
  std::string text = "x,y,z\n";
  for (int i = 0; i < 120; ++i) {
    for (int j = 0; j < 120; ++j) {
      text += std::to_string(0.1 * i - 6.0) + "," + std::to_string(0.1 * j - 6.0) + ",-1.2\n";
    }
  }
  for (const char* n : {"0", "1"}) Write(std::string("scans/Hokuyo_") + n + ".csv", text);
  Write("truth.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0.3 0 1 0 0 0 0 1 0\n");
  const Outcome outcome =
      Lamina({"compare", "--scans", Path("scans"), "--truth", Path("truth.txt"), "--out",
              Path("out"), "--methods", "teaser,sync_teaser,fgr,condensed", "--progress", "off"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  for (const char* method : {"teaser", "fgr"}) {
    EXPECT_THAT(Row(method)["reason"].get<std::string>(), HasSubstr("do not face all directions"));
  }
  // Its initial poses would have been teaser's.
  EXPECT_THAT(Row("condensed")["reason"].get<std::string>(), HasSubstr("no initial poses"));
}

TEST_F(CompareTest, WrongUsageIsNamed) {
  WriteStairs();
  EXPECT_THAT(Compare("best", {}, 2).err, HasSubstr("--methods best: must be all, or of f2f_icp"));
  EXPECT_THAT(Lamina({"compare", "--out", Path("out")}).err, HasSubstr("give one of --scans"));
  const Outcome none = Lamina({"compare", "--data", Path("scans/..."), "--out", Path("out")});
  EXPECT_EQ(none.code, 1);
}

TEST_F(CompareTest, TheDataSetIsFoundByTheNamesOfItsFolders) {
  WriteStairs(3);
  fs::create_directories(Path("ethz/Stairs"));
  fs::rename(Path("scans"), Path("ethz/Stairs/csv_local"));
  const Outcome outcome =
      Lamina({"compare", "--data", Path("ethz"), "--out", Path("out"), "--methods", "vgicp",
              "--initial", "truth+noise", "--noise-m", "0.02", "--noise-deg", "0.5"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("| RPE / APE, cm | stairs |"));
  EXPECT_THAT(outcome.err, HasSubstr("has no folder of apartment"));
}

TEST(CompareMethods, NamesAreFoundAndShareJobs) {
  const std::vector<std::string> methods = ParseMethods("condensed,gicp,sync_fgr,fgr");
  EXPECT_THAT(methods,
              testing::ElementsAre("f2f_gicp", "f2m_gicp", "fgr", "sync_fgr", "condensed"));
  const std::vector<CompareJob> jobs = GroupIntoJobs(methods);
  ASSERT_EQ(jobs.size(), 3U);
  EXPECT_THAT(jobs[1], testing::ElementsAre("fgr", "sync_fgr"));
  EXPECT_EQ(ParseMethods("all").size(), CompareMethods().size());
}

TEST(CompareStructure, DistancesAreThoseToTheNearestPoint) {
  std::vector<Eigen::Vector3f> plane;
  for (int i = -100; i <= 100; ++i) {
    for (int j = -100; j <= 100; ++j) {
      plane.emplace_back(0.02F * static_cast<float>(i), 0.02F * static_cast<float>(j), 0.0F);
    }
  }
  const ReferenceCloud reference(plane);
  EXPECT_NEAR(reference.Distance({0.5F, 0.5F, 0.04F}), 0.04, 1e-6);
  EXPECT_NEAR(reference.Distance({0.5F, 0.5F, 0.23F}), 0.23, 1e-6);
  EXPECT_NEAR(reference.Distance({0.5F, 0.5F, 9.0F}), kStructuralBoundM, 1e-6);
  // The map is 3 cm above the plane by its poses, but aligned to the truth as a whole.
  const std::vector<SE3> truth(2);
  std::vector<SE3> poses(2);
  poses[0].t.z() = poses[1].t.z() = 0.03;
  EXPECT_LT(Summarise(MeasureStructure({plane, plane}, poses, truth, reference)).mean_m, 1e-6);
  // Apart from one another by 4 cm, no alignment helps.
  poses[1].t.z() = -0.01;
  const StructuralError error = Summarise(MeasureStructure({plane, {}}, poses, truth, reference));
  EXPECT_NEAR(error.median_m, 0.02, 1e-6);
  EXPECT_NEAR(error.within_5cm, 1.0, 1e-9);
}

TEST(CompareStructure, AlignmentTurnsTheWholeEvenWhereAllStandInALine) {
  std::vector<SE3> truth, poses;
  const SE3 moved(ExpSO3({0.3, -0.2, 1.0}), Eigen::Vector3d(1, 2, 3));
  for (int k = 0; k < 5; ++k) {
    truth.emplace_back(ExpSO3({0.0, 0.0, 0.1 * k}), Eigen::Vector3d(k, 0, 0));
    poses.push_back(moved * truth.back());
  }
  const SE3 T = AlignPoses(poses, truth);
  for (std::size_t k = 0; k < 5; ++k) {
    EXPECT_LT(((T * poses[k]).t - truth[k].t).norm(), 1e-9);
    EXPECT_LT(RotationAngle(T * poses[k], truth[k]), 1e-9);
  }
}

}  // namespace
}  // namespace lamina
