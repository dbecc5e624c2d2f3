// What `lamina run` does with recordings and orders that are not as they should be.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "tests/support/program/run_helpers.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::SizeIs;

constexpr std::size_t kScansGiven = 16;
constexpr std::size_t kBad = 8;  // the scan that is spoilt

// The points of a scan, each changed by `change`.
std::string Changed(const std::string& bytes, const std::function<void(ScanPoint*)>& change) {
  std::vector<ScanPoint> points(bytes.size() / sizeof(ScanPoint));
  std::memcpy(points.data(), bytes.data(), bytes.size());
  for (ScanPoint& point : points) change(&point);
  return KittiBin(points);
}

class RunBadInputTest : public RunTest {
 protected:
  // Runs a street with one scan replaced, which must be skipped for `reason` with one line that has
  // `message`, and must leave the other poses as they are.
  void ExpectSkipped(const std::string& bytes, const std::string& reason,
                     const std::string& message) {
    Recording recording = Street(kScansGiven);
    const std::string good = WriteRecording("good", recording);
    recording[kBad].bytes = bytes;
    ExpectSkippedScans(WriteRecording("bad", recording), reason, message, 1);
    Run(good, {}, 0, "good_out");
    EXPECT_LT(LargestDistance(AllScans(), AllScans("good_out")), 0.05);
  }

  void ExpectSkippedScans(const std::string& scans, const std::string& reason,
                          const std::string& message, std::size_t count) {
    const Outcome outcome = Run(scans);
    std::size_t lines = 0;
    for (const std::string& line : Lines(outcome.err)) {
      if (line.find("skipped scan") == std::string::npos) continue;
      ++lines;
      EXPECT_THAT(line, HasSubstr(message));
    }
    EXPECT_EQ(lines, count) << outcome.err;
    const nlohmann::json summary = Summary();
    EXPECT_EQ(summary["skipped_scans"], count);
    EXPECT_EQ(summary["skipped_by_reason"], nlohmann::json({{reason, count}}));
    EXPECT_EQ(summary["frames"], kScansGiven - count);
    EXPECT_EQ(summary["lost_frames"], 0);
    EXPECT_THAT(Lines(Bytes(Path("out/trajectory_kitti.txt"))), SizeIs(kScansGiven));
    EXPECT_THAT(Lines(Bytes(Path("out/trajectory_tum.txt"))), SizeIs(kScansGiven - count));
    EXPECT_THAT(Bytes(Path("out/frames.csv")), HasSubstr("," + reason + ","));
  }

  // Runs a recording of which nothing can be used.
  void ExpectNothingUsable(const std::string& bytes, const std::string& reason) {
    const std::string scans = WriteRecording("all_bad", {{bytes, 0.0}, {bytes, 0.1}});
    const Outcome outcome = Run(scans, {}, 1, "none");
    EXPECT_THAT(outcome.err, AllOf(HasSubstr(scans), HasSubstr("not one usable scan")));
    EXPECT_EQ(Summary("none")["skipped_by_reason"], nlohmann::json({{reason, 2}}));
  }
};

TEST_F(RunBadInputTest, MissingFolder) {
  const Outcome outcome = Run(Path("nowhere"), {}, 1);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("error: "), HasSubstr(Path("nowhere"))));
  EXPECT_FALSE(std::filesystem::exists(Path("out")));
}

TEST_F(RunBadInputTest, EmptyFolder) {
  std::filesystem::create_directories(Path("empty"));
  const Outcome outcome = Run(Path("empty"), {}, 1);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr(Path("empty")), HasSubstr("holds no scans")));
}

TEST_F(RunBadInputTest, TruncatedScan) {
  const std::string bytes = Street(kScansGiven)[kBad].bytes;
  const std::string truncated = bytes.substr(0, bytes.size() - 5);
  ExpectSkipped(truncated, "unreadable", "000008.bin");
  ExpectNothingUsable(truncated, "unreadable");
}

TEST_F(RunBadInputTest, EmptyScan) { ExpectSkipped("", "unreadable", "000008.bin"); }

TEST_F(RunBadInputTest, ScanOfNaN) {
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  const std::string bytes =
      KittiBin(std::vector<ScanPoint>(2000, ScanPoint{kNaN, kNaN, kNaN, 0.5F}));
  ExpectSkipped(bytes, "too_few_points", "2000 not finite");
  ExpectNothingUsable(bytes, "too_few_points");
}

TEST_F(RunBadInputTest, SinglePoint) {
  const std::string bytes = KittiBin({{10.0F, 1.0F, 0.0F, 0.5F}});
  ExpectSkipped(bytes, "too_few_points", "1 usable points");
  ExpectNothingUsable(bytes, "too_few_points");
}

TEST_F(RunBadInputTest, ScanAtAMillionKilometres) {
  const std::string bytes =
      Changed(Street(kScansGiven)[kBad].bytes, [](ScanPoint* p) { p->x = 1e9F; });
  ExpectSkipped(bytes, "too_few_points", "out of range");
}

TEST_F(RunBadInputTest, SomePointsAtAMillionKilometres) {
  Recording recording = Street(kScansGiven);
  Run(WriteRecording("good", recording), {}, 0, "good_out");
  for (RecordedScan& scan : recording) {
    scan.bytes += KittiBin({{1e9F, 0.0F, 0.0F, 0.0F},
                            {-1e9F, 1e9F, -1e9F, 0.0F},
                            {std::numeric_limits<float>::infinity(), 0.0F, 0.0F, 0.0F},
                            {std::numeric_limits<float>::max(), 1e30F, 0.0F, 0.0F}});
  }
  Run(WriteRecording("bad", recording));
  EXPECT_EQ(Summary()["skipped_scans"], 0);
  EXPECT_EQ(Bytes(Path("out/trajectory_kitti.txt")), Bytes(Path("good_out/trajectory_kitti.txt")));
}

TEST_F(RunBadInputTest, ThousandIdenticalScans) {
  const Recording room = SyntheticRecording(synth::SceneKind::kRoom, 1, 8);
  const std::string scans = WriteRepeated("still", room[0].bytes, 1000);
  Run(scans);
  EXPECT_EQ(Summary()["frames"], 1000);
  EXPECT_EQ(Summary()["lost_frames"], 0);
  EXPECT_LT(LargestDistance(AllScans(), Trajectory(1000)), 0.02);
}

TEST_F(RunBadInputTest, DuplicatedStamp) {
  Recording recording = Street(kScansGiven);
  recording[kBad].stamp_s = recording[kBad - 1].stamp_s;
  const std::string scans = WriteRecording("bad", recording);
  ExpectSkippedScans(scans, "stamp_not_after_last", "is not after the last one", 1);
}

TEST_F(RunBadInputTest, DecreasingStamps) {
  Recording recording = Street(kScansGiven);
  for (std::size_t i = kBad; i < kBad + 3; ++i) {
    recording[i].stamp_s = 0.05 - 0.01 * static_cast<double>(i - kBad);
  }
  const std::string scans = WriteRecording("bad", recording);
  ExpectSkippedScans(scans, "stamp_not_after_last", "is not after the last one", 3);
}

TEST_F(RunBadInputTest, GapsOfSeconds) {
  // The sensor stands still meanwhile, and goes on as before.
  Recording recording = Street(kScansGiven);
  Run(WriteRecording("good", recording), {}, 0, "good_out");
  for (std::size_t i = 0; i < kScansGiven; ++i) {
    recording[i].stamp_s += (i >= 6 ? 3.0 : 0.0) + (i >= 11 ? 60.0 : 0.0);
  }
  Run(WriteRecording("gaps", recording));
  EXPECT_EQ(Summary()["frames"], kScansGiven);
  EXPECT_EQ(Summary()["lost_frames"], 0);
  EXPECT_LT(LargestDistance(AllScans(), AllScans("good_out")), 0.05);
}

TEST_F(RunBadInputTest, RotatedScanIsLostAlone) {
  Recording recording = Street(kScansGiven);
  Run(WriteRecording("good", recording), {}, 0, "good_out");
  recording[kBad].bytes = Changed(recording[kBad].bytes, [](ScanPoint* p) {
    const float x = p->x;
    p->x = -p->y;
    p->y = x;
  });
  const Outcome outcome = Run(WriteRecording("bad", recording));
  EXPECT_THAT(outcome.err, HasSubstr("lost at scan 8"));
  EXPECT_EQ(Summary()["lost_frames"], 1);
  EXPECT_EQ(Summary()["frames"], kScansGiven);
  EXPECT_EQ(Summary()["restarts"], 0);
  EXPECT_LT(LargestDistance(AllScans(), AllScans("good_out")), 0.1);
  EXPECT_THAT(Bytes(Path("out/frames.csv")), HasSubstr("\n8,0.800000000,lost,0,"));
}

TEST_F(RunBadInputTest, ALostScanDelaysNothingWhereSearchIsOff) {
  Recording recording = Street(kScansGiven);
  recording[kBad].bytes = Changed(recording[kBad].bytes, [](ScanPoint* p) {
    const float x = p->x;
    p->x = -p->y;
    p->y = x;
  });
  Run(WriteRecording("bad", recording), {"--set", "frontend.search.enabled=false"});
  EXPECT_EQ(Summary()["lost_frames"], 1);
  EXPECT_EQ(Summary()["pieces"].size(), 1U);
}

TEST_F(RunBadInputTest, OutputFolderThatCannotBeMade) {
  const std::string scans = WriteRecording("street", Street(2));
  Write("file", "not a folder");
  const Outcome outcome = Run(scans, {}, 1, "file/out");
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("error: "), HasSubstr(Path("file/out"))));
  EXPECT_EQ(Bytes(Path("file")), "not a folder");
}

TEST_F(RunBadInputTest, OutputFolderThatIsAFile) {
  const std::string scans = WriteRecording("street", Street(2));
  Write("file", "not a folder");
  EXPECT_THAT(Run(scans, {}, 1, "file").err, AllOf(HasSubstr("error: "), HasSubstr(Path("file"))));
}

TEST_F(RunBadInputTest, FullDisk) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full";
  const std::string scans = WriteRecording("street", Street(6));
  for (const char* name : {"frames.csv", "map_surfels.ply", "trajectory_tum.txt", "summary.json"}) {
    std::filesystem::create_directories(Path("out"));
    std::filesystem::create_symlink("/dev/full", Path(std::string("out/") + name + ".partial"));
    const Outcome outcome = Run(scans, {}, 1);
    EXPECT_THAT(outcome.err, AllOf(HasSubstr("error: "), HasSubstr(Path("out/") + name),
                                   HasSubstr("No space left on device")));
    EXPECT_FALSE(std::filesystem::exists(Path(std::string("out/") + name)));
    EXPECT_FALSE(std::filesystem::exists(Path("out/summary.json")));
    std::filesystem::remove_all(Path("out"));
  }
}

TEST_F(RunBadInputTest, FileLargerThanTheSystemAllows) {
  const std::string scans = WriteRecording("street", Street(6));
  const struct {
    const char *loops, *file;
  } kCases[] = {{"off", "map_surfels.ply"}, {"on", "submaps.scratch"}};
  for (const auto& [loops, file] : kCases) {
    const std::string out = Path(std::string("out_") + loops);
    const Outcome outcome = Lamina({"run", "--scans", scans, "--out", out, "--loops", loops}, [] {
      std::signal(SIGXFSZ, SIG_IGN);
      const rlimit limit{8192, 8192};
      setrlimit(RLIMIT_FSIZE, &limit);
    });
    EXPECT_EQ(outcome.code, 1) << loops;
    EXPECT_THAT(outcome.err, AllOf(HasSubstr("error: "), HasSubstr(out + "/" + file),
                                   HasSubstr("File too large")));
    // Nothing half-written is left.
    for (const char* left :
         {"map_surfels.ply", "map_surfels.ply.partial", "summary.json", "submaps.scratch"}) {
      EXPECT_FALSE(std::filesystem::exists(out + "/" + left)) << loops << " " << left;
    }
  }
}

TEST_F(RunBadInputTest, OptionsAgainstTheirRules) {
  const std::string scans = WriteRecording("street", Street(2));
  const struct {
    const char *option, *value, *message;
  } kCases[] = {
      {"--set", "map.budget=3", "map.budget_mb"},
      {"--set", "map.budget_mb=-1", "map.budget_mb"},
      {"--set", "map.budget_mb=nan", "map.budget_mb"},
      {"--set", "map.budget_mb=much", "must be a number"},
      {"--set", "preparation.deskew=perhaps", "must be one of"},
      {"--set", "nonsense", "nonsense"},
      {"--frames", "5", "A:B"},
      {"--frames", "a:b", "A:B"},
      {"--frames", "-1:2", "A:B"},
      {"--frames", "2:1", "names none of the 2 scans"},
      {"--frames", "9:", "names none of the 2 scans"},
  };
  for (const auto& bad : kCases) {
    const Outcome outcome = Run(scans, {bad.option, bad.value}, 2);
    EXPECT_THAT(outcome.err, AllOf(HasSubstr(bad.option), HasSubstr(bad.message))) << bad.value;
  }
  EXPECT_FALSE(std::filesystem::exists(Path("out")));
}

TEST_F(RunBadInputTest, BadConfigurationFile) {
  const std::string scans = WriteRecording("street", Street(2));
  const std::string config = Write("bad.yaml", "map:\n  root_size_m: 1.0\n  colour: red\n");
  EXPECT_THAT(Run(scans, {"--config", config}, 2).err,
              AllOf(HasSubstr(config + ":3"), HasSubstr("map.colour")));
  const std::string range = Write("range.yaml", "map:\n  depth: 9\n");
  EXPECT_THAT(Run(scans, {"--config", range}, 2).err,
              AllOf(HasSubstr(range + ":2"), HasSubstr("map.depth")));
  EXPECT_THAT(Run(scans, {"--config", Path("no.yaml")}, 1).err, HasSubstr(Path("no.yaml")));
}

}  // namespace
}  // namespace lamina
