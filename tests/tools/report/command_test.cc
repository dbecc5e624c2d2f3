#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <regex>

#include "core/base/error.h"
#include "io/map/map_io.h"
#include "io/map/trajectory_io.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/program/browser.h"
#include "tests/support/scenes/live_world.h"
#include "tools/report/command.h"
#include "tools/report/data.h"
#include "tools/report/page.h"

namespace lamina {
namespace {

using Json = nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

class ReportTest : public FilesTest {
 protected:
  // The folder "run" of a drive past the surfels of LiveWorld.
  void WriteRun(int poses = 40) const {
    std::filesystem::create_directories(Path("run"));
    const LiveWorld world(50.0, 0.5);
    SurfelMap map;
    for (const MapCell& cell : world.Answer({{20, 0, 0}, 1e4, 0, -1}).cells) {
      map.insert(map.end(), cell.surfels.begin(), cell.surfels.end());
    }
    WriteSurfels(Path("run/map_surfels.ply"), map);
    const Trajectory trajectory = Drive(poses, 0.0);
    WriteTumTrajectory(Path("run/trajectory_tum.txt"), trajectory);
    WriteKittiTrajectory(Path("run/trajectory_kitti.txt"), trajectory);
    std::string csv = "scan,status,read_ms,odometry_ms,solve_ms\n";
    for (int i = 0; i < poses; ++i) csv += std::to_string(i) + ",tracked,1.5,10,3.25\n";
    Write("run/frames.csv", csv);
    Write("run/summary.json",
          R"({"frames": 40, "note": "</script><!-- <b>", "skipped_by_reason": {"empty": 2},
              "verdict": {"verdict": "doubtful", "reasons": ["12 % are <i>lost"], "hint": "Look."}})");
  }

  // Errs by `error_m` at every second pose.
  static Trajectory Drive(int poses, double error_m) {
    Trajectory trajectory;
    for (int i = 0; i < poses; ++i) {
      const LivePose pose = LiveWorld::Frame(i).pose;
      trajectory.push_back({pose.stamp_ns + 5000000000, pose.T_world_lidar});
      trajectory.back().T_world_lidar.t.z() += i % 2 == 0 ? error_m : -error_m;
    }
    return trajectory;
  }

  static int Run(const std::string& line) {
    CLI::App app;
    std::function<int()> run;
    AddReportCommand(&app, &run);
    app.parse(line, false);
    return run();
  }

  ReportSource Source() const {
    ReportSource source;
    source.folder = Path("run");
    return source;
  }

  std::string MessageFor() const {
    return MessageOf<InputError>([&] { ReadReportData(Source()); });
  }
};

TEST(Base64, AsInRfc4648) {
  EXPECT_EQ(Base64(""), "");
  EXPECT_EQ(Base64("f"), "Zg==");
  EXPECT_EQ(Base64("fo"), "Zm8=");
  EXPECT_EQ(Base64("foo"), "Zm9v");
  EXPECT_EQ(Base64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(Base64("\xff\xff\xff\xfe"), "/////g==");
  EXPECT_EQ(Base64Floats({1.0}), "AACAPw==");
}

TEST_F(ReportTest, DataHoldsErrorsAgainstTheTruth) {
  WriteRun();
  WriteTumTrajectory(Path("truth.txt"), Drive(40, 0.1));
  ReportSource source = Source();
  source.truth = Path("truth.txt");
  const Json data = ReadReportData(source);
  EXPECT_EQ(data["name"], "run");
  EXPECT_NEAR(data["truth"]["figures"]["ape_rmse_m"], 0.1, 0.005);
  EXPECT_EQ(data["truth"]["axis_name"], "s");
  EXPECT_EQ(data["truth"]["group"], 1);
  EXPECT_EQ(data["timings"]["stages"].size(), 3U);
  EXPECT_EQ(data["summary"]["frames"], 40);
  // Without stamps, the lines are the scans.
  WriteKittiTrajectory(Path("truth.txt"), Drive(40, 0.1));
  EXPECT_NEAR(ReadReportData(source)["truth"]["figures"]["ape_rmse_m"], 0.1, 0.005);
  EXPECT_EQ(ReadReportData(source)["truth"]["axis_name"], "scan");
}

TEST_F(ReportTest, LargeMapsAreThinnedEvenly) {
  WriteRun();
  ReportSource source = Source();
  const Json all = ReadReportData(source)["map"];
  EXPECT_EQ(all["shown"], all["surfels"]);
  source.max_surfels = 1000;
  const Json some = ReadReportData(source)["map"];
  EXPECT_EQ(some["surfels"], all["surfels"]);
  EXPECT_EQ(some["shown"], 1000);
  EXPECT_LT(some["cells"].get<std::string>().size(), all["cells"].get<std::string>().size() / 3);
}

TEST_F(ReportTest, LongRunsKeepTheirPeaks) {
  WriteRun();
  std::string csv = "scan,read_ms\n";
  for (int i = 0; i < 45000; ++i) csv += std::to_string(i) + (i == 31 ? ",77\n" : ",1\n");
  Write("run/frames.csv", csv);
  const Json timings = ReadReportData(Source())["timings"];
  EXPECT_EQ(timings["group"], 3);
  const std::string read = timings["stages"]["read_ms"];
  EXPECT_EQ(read.size(), 15000U * 4 / 3 * 4);
  EXPECT_EQ(read.substr(0, 80).find(Base64Floats({1, 1, 1}).substr(0, 16)), 0U);
  EXPECT_NE(read, Base64Floats(std::vector<double>(15000, 1.0)));
}

TEST_F(ReportTest, FilesThatMayBeMissing) {
  WriteRun();
  std::filesystem::remove(Path("run/frames.csv"));
  std::filesystem::remove(Path("run/summary.json"));
  const Json data = ReadReportData(Source());
  EXPECT_FALSE(data.contains("timings"));
  EXPECT_FALSE(data.contains("summary"));
}

TEST_F(ReportTest, TheVerdictIsThatOfTheSummary) {
  WriteRun();
  EXPECT_EQ(ReadReportData(Source())["verdict"]["reasons"][0], "12 % are <i>lost");
  // Another program's, or an older run's.
  for (const char* summary :
       {"{}", R"({"verdict": 3})", R"({"verdict": {"verdict": "good", "reasons": "x"}})",
        R"({"verdict": {"verdict": "superb", "reasons": [], "hint": ""}})"}) {
    Write("run/summary.json", summary);
    EXPECT_FALSE(ReadReportData(Source()).contains("verdict")) << summary;
  }
}

TEST_F(ReportTest, BadInputIsNamed) {
  EXPECT_THAT(MessageFor(), HasSubstr("run: is no folder"));
  WriteRun();
  Write("run/frames.csv", "scan,read_ms\n0,1\n1\n");
  EXPECT_THAT(MessageFor(), HasSubstr("frames.csv:3: has 1 columns"));
  Write("run/frames.csv", "scan,read_ms\n0,fast\n");
  EXPECT_THAT(MessageFor(), AllOf(HasSubstr("frames.csv:2"), HasSubstr("'fast'")));
  Write("run/frames.csv", "scan\n0\n");
  EXPECT_THAT(MessageFor(), HasSubstr("no column of times"));
  Write("run/frames.csv", "");
  EXPECT_THAT(MessageFor(), HasSubstr("is empty"));
  Write("run/frames.csv", "scan,read_ms\n");
  Write("run/summary.json", "{");
  EXPECT_THAT(MessageFor(), HasSubstr("summary.json: is no JSON"));
  Write("run/summary.json", "{}");
  SurfelMap far(1, Surfel{{1e12, 0, 0}, {0, 0, 1}, {1, 1, 0}, 1});
  WriteSurfels(Path("run/map_surfels.ply"), far);
  EXPECT_THAT(MessageFor(), HasSubstr("surfel 0 lies beyond"));
  std::filesystem::remove(Path("run/map_surfels.ply"));
  EXPECT_THAT(MessageFor(), HasSubstr("map_surfels.ply"));
  std::filesystem::remove(Path("run/trajectory_tum.txt"));
  EXPECT_THAT(MessageFor(), HasSubstr("trajectory_tum.txt"));
}

TEST_F(ReportTest, UsageIsChecked) {
  WriteRun();
  const std::string out = " --out " + Path("report.html");
  EXPECT_THROW(Run("report" + out), OptionError);
  EXPECT_THROW(Run("report --run a --session b" + out), OptionError);
  EXPECT_THROW(Run("report --run a --calib c" + out), OptionError);
  EXPECT_THROW(Run("report --run a --max-surfels 0" + out), CLI::ParseError);
  EXPECT_THROW(Run("report --run " + Path("run") + " --out " + Path("none/report.html")),
               OutputError);
  EXPECT_THAT(MessageOf<InputError>([&] {
                ReportPage({"", "/nowhere"}, "report.html", {});
              }),
              HasSubstr("report.html"));
  EXPECT_FALSE(std::filesystem::exists(Path("report.html")));
}

TEST_F(ReportTest, OneFileWithoutAnyReferenceToAnother) {
  WriteRun();
  ASSERT_EQ(Run("report --session " + Path("run") + " --out " + Path("report.html")), 0);
  const std::string page = Bytes(Path("report.html"));
  const std::regex kReference(R"re(<(script|link|img)[^>]*(src|href)="([^"]*)")re");
  for (std::sregex_iterator i(page.begin(), page.end(), kReference), end; i != end; ++i) {
    EXPECT_EQ((*i)[3], "data:,") << i->str();
  }
  EXPECT_THAT(page, Not(HasSubstr("<b>")));
  ASSERT_EQ(Run("report --run " + Path("run") + " --out " + Path("again.html")), 0);
  EXPECT_EQ(Bytes(Path("again.html")), page);
}

TEST_F(ReportTest, OpensFromAFileAndDraws) {
  if (!Browser::IsInstalled()) GTEST_SKIP() << "chromium and chromium-driver are not installed";
  WriteRun();
  WriteTumTrajectory(Path("truth.txt"), Drive(40, 0.1));
  ASSERT_EQ(Run("report --run " + Path("run") + " --out " + Path("report.html") + " --truth " +
                Path("truth.txt") + " --max-surfels 4000"),
            0);
  Browser browser(Path("profile"), 900, 700);
  browser.Go("file://" + Path("report.html"));
  ASSERT_FALSE(browser.WaitFor("!!lamina.viewer").is_null());
  EXPECT_EQ(browser.Run("return lamina.viewer.map.count"), 4000);
  EXPECT_EQ(browser.Run("return lamina.poses.length"), 40);
  EXPECT_GT(browser.Run("return lamina.viewer.countPixels() / (lamina.viewer.canvas.width * "
                        "lamina.viewer.canvas.height)"),
            0.05);
  const std::string text = browser.Run("return document.body.innerText");
  EXPECT_THAT(text, AllOf(HasSubstr("4,000 of "), HasSubstr("40 poses"), HasSubstr("0.2000 m"),
                          HasSubstr("</script><!-- <b>"), HasSubstr("odometry"),
                          HasSubstr("doubtful: 12 % are <i>lost. Look.")));
  // A chart that has been drawn has pixels.
  for (const char* chart : {"position-error", "rotation-error", "stages"}) {
    EXPECT_TRUE(browser.Run(std::string("const c = document.querySelector('#") + chart +
                            " canvas'); return c.getContext('2d').getImageData(0, 0, c.width, "
                            "c.height).data.some((v) => v > 0)"))
        << chart;
  }
  EXPECT_THAT(browser.Errors(), IsEmpty());
}

}  // namespace
}  // namespace lamina
