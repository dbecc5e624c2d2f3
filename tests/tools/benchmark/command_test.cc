// `lamina bench` as a whole, on recordings of a few hundred points a scan: what is written, not how
// long it took.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/program/run_helpers.h"

namespace lamina {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class BenchCommand : public RunTest {
 protected:
  Outcome Bench(std::vector<std::string> more) const {
    more.insert(more.begin(), {"bench", "--out", Path("bench")});
    return Lamina(more);
  }
  nlohmann::json Figures() const {
    return nlohmann::json::parse(Bytes(Path("bench/bench.json")), nullptr, false);
  }
};

TEST_F(BenchCommand, MeasuresACaseAndComparesWithTheTimeBefore) {
  const std::string scans = WriteRecording("street", Street(4));
  const std::vector<std::string> arguments = {
      "--case", "tiny=" + scans + ",kitti_raw", "--only", "tiny", "--repetitions", "2", "--threads",
      "1"};
  const Outcome outcome = Bench(arguments);
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(Bytes(Path("bench/bench.md")), outcome.out.substr(0, outcome.out.find("\ntable ")));
  const nlohmann::json json = Figures();
  ASSERT_EQ(json["rows"].size(), 1U);
  EXPECT_EQ(json["rows"][0]["case"], "tiny");
  EXPECT_EQ(json["rows"][0]["frames"], 4);
  std::map<std::string, std::size_t> runs;
  for (const nlohmann::json& figure : json["rows"][0]["figures"])
    runs[figure["name"].get<std::string>()] = figure["runs"].size();
  for (const char* name :
       {"cpu_ms", "wall_ms", "frames_per_s", "process_cpu_s", "read_ms", "prepare_ms", "cluster_ms",
        "odometry_ms", "map_ms", "solve_ms", "peak_rss_mb", "map_mb", "bytes_a_leaf", "floor_ms",
        "over_floor", "first_scan_ms", "searched", "lost"})
    EXPECT_EQ(runs[name], 2U) << name;

  // The same figures against themselves: no difference.
  std::filesystem::copy_file(Path("bench/bench.json"), Path("before.json"));
  const Outcome same = Bench({"--results", Path("before.json"), "--against", Path("before.json")});
  ASSERT_EQ(same.code, 0) << same.err;
  EXPECT_THAT(same.out, AllOf(HasSubstr("| tiny, 1 thread | cpu_ms, ms |"), HasSubstr("| equal |"),
                              Not(HasSubstr("%**"))));
}

TEST_F(BenchCommand, StudiesHowTheCostGrows) {
  if (std::system("gnuplot --version >/dev/null 2>&1") != 0) GTEST_SKIP() << "no gnuplot";
  const Outcome outcome =
      Bench({"--scaling", "--scaling-points", "500,1000", "--scaling-windows", "3,4",
             "--scaling-lengths", "4,8", "--threads", "1", "--frames", "4", "--repetitions", "1"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(Bytes(Path("bench/scaling.md")),
              AllOf(HasSubstr("points a scan"), HasSubstr("frames of the window"),
                    HasSubstr("voxels of the map"), HasSubstr("| cpu_ms |")));
  EXPECT_GT(std::filesystem::file_size(Path("bench/scaling.svg")), 1000U);
  EXPECT_TRUE(nlohmann::json::accept(Bytes(Path("bench/scaling.json"))));
}

TEST_F(BenchCommand, ErrorsNameWhatIsWrong) {
  const auto said = [&](int code, const std::vector<std::string>& arguments) {
    const Outcome outcome = Bench(arguments);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    return outcome.err;
  };
  EXPECT_THAT(said(2, {"--only", "hdl46"}), HasSubstr("hdl46"));
  EXPECT_THAT(said(2, {"--case", "tiny"}), HasSubstr("NAME=SCANS,CONFIG"));
  EXPECT_THAT(said(2, {"--repetitions", "0"}), HasSubstr("--repetitions = 0"));
  EXPECT_THAT(said(2, {"--threads", "0"}), HasSubstr("--threads = 0"));
  // Before anything is generated or mapped.
  EXPECT_THAT(said(2, {"--scaling", "--scaling-windows", "2,3"}),
              AllOf(HasSubstr("backend.window.frames = 2"), Not(HasSubstr("recording"))));
  EXPECT_THAT(said(1, {"--against", Path("none.json")}), HasSubstr("none.json"));
  EXPECT_THAT(said(1, {"--results", Write("broken.json", "{\"bench\": 1,")}),
              HasSubstr("broken.json: is no JSON object"));
  EXPECT_THAT(said(1, {"--case", "gone=" + Path("gone"), "--only", "gone"}), HasSubstr("gone"));
  const std::string scans = WriteRecording("street", Street(2));
  EXPECT_THAT(said(1, {"--case", "a=" + scans, "--only", "a", "--program", Path("none")}),
              HasSubstr("cannot start " + Path("none")));
}

}  // namespace
}  // namespace lamina
