// `lamina campaign`, alone and under mpirun: the same bytes, whatever was there already.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/program/run_helpers.h"
#include "tools/campaign/campaign.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const std::vector<std::string> kMade = {"drives/first/trajectory_tum.txt",
                                        "drives/first/submaps.bin",
                                        "drives/second/trajectory_tum.txt",
                                        "drives/second/submaps.bin",
                                        "map/trajectory_tum.txt",
                                        "map/submaps.bin",
                                        "map/graph.g2o",
                                        "map/loops.csv"};

class CampaignTest : public RunTest {
 protected:
  // Two drives along one street, and a recording that is none.
  std::string WriteList() const {
    const Recording street = Street(30);
    WriteRecording("first", street);
    Recording later(street.begin() + 4, street.end());
    for (RecordedScan& scan : later) scan.stamp_s += 1000.0;
    WriteRecording("second", later);
    Write("broken/velodyne/000000.bin", "no points");
    return Write("list.yaml", "recordings:\n  - first\n  - second\n  - broken\n");
  }
  std::vector<std::string> Arguments(const std::string& list, const std::string& out) const {
    return {"campaign", "--recordings",           list, "--out", Path(out),
            "--set",    "loops.submap.length_m=8"};
  }
  std::vector<std::string> ByKeyframes(const std::string& list, const std::string& out) const {
    std::vector<std::string> arguments = Arguments(list, out);
    arguments.insert(arguments.end(), {"--level", "keyframes", "--tile-size", "15"});
    return arguments;
  }
  // Under mpirun. Returns what it said.
  std::string InRanks(int ranks, const std::vector<std::string>& arguments) const {
    std::string command = "mpirun --allow-run-as-root --oversubscribe -n " + std::to_string(ranks);
    command += std::string(" ") + LAMINA_PROGRAM;
    for (const std::string& argument : arguments) command += " '" + argument + "'";
    command += " > '" + Path("stdout") + "' 2> '" + Path("stderr") + "'";
    EXPECT_NE(std::system(command.c_str()), 0);  // one is left out
    return Bytes(Path("stderr"));
  }
  nlohmann::json Figures(const std::string& out) const {
    return nlohmann::json::parse(Bytes(Path(out + "/campaign.json")));
  }
  void ExpectSame(const std::string& a, const std::string& b) const {
    for (const std::string& name : kMade) {
      ASSERT_TRUE(fs::exists(Path(a + "/" + name))) << a << "/" << name;
      EXPECT_EQ(Bytes(Path(a + "/" + name)), Bytes(Path(b + "/" + name))) << name;
    }
  }
};

TEST_F(CampaignTest, MapsAndJoinsLeavesOutWhatIsBrokenAndGoesOn) {
  const std::string list = WriteList();
  const Outcome first = Lamina(Arguments(list, "out"));
  EXPECT_EQ(first.code, 1) << first.err;  // one is left out
  EXPECT_THAT(first.err, HasSubstr("broken is left out"));
  const nlohmann::json figures = Figures("out");
  EXPECT_EQ(figures["recordings"][0]["status"], "mapped");
  EXPECT_EQ(figures["recordings"][2]["status"], "left out");
  EXPECT_FALSE(fs::exists(Path("out/drives/broken")));

  // Ended in the middle of a drive and of the map: what is whole is kept, the rest made again.
  fs::copy(Path("out"), Path("again"), fs::copy_options::recursive);
  const auto kept = fs::last_write_time(Path("again/drives/first/submaps.bin"));
  fs::rename(Path("again/drives/second"), Path("again/drives/second.part"));
  fs::remove(Path("again/drives/second.part/campaign.yaml"));
  fs::rename(Path("again/map"), Path("again/map.part"));
  EXPECT_EQ(Lamina(Arguments(list, "again")).code, 1);
  EXPECT_EQ(fs::last_write_time(Path("again/drives/first/submaps.bin")), kept);
  EXPECT_EQ(Figures("again")["recordings"][0]["status"], "there already");
  EXPECT_EQ(Figures("again")["recordings"][1]["status"], "mapped");
  EXPECT_FALSE(fs::exists(Path("again/map.part")));
  ExpectSame("out", "again");

  // All of it is there; other options make all of it anew.
  const auto map = fs::last_write_time(Path("out/map/submaps.bin"));
  EXPECT_THAT(Lamina(Arguments(list, "out")).out, HasSubstr("their map is there already"));
  EXPECT_EQ(fs::last_write_time(Path("out/map/submaps.bin")), map);
  // A recording that has changed is mapped anew.
  fs::remove(Path("second/velodyne/" + ScanName(25)));
  Lamina(Arguments(list, "out"));
  EXPECT_EQ(Figures("out")["recordings"][0]["status"], "there already");
  EXPECT_EQ(Figures("out")["recordings"][1]["status"], "mapped");
  std::vector<std::string> other = Arguments(list, "out");
  other.insert(other.end(), {"--set", "backend.window.frames=12"});
  Lamina(other);
  EXPECT_EQ(Figures("out")["recordings"][0]["status"], "mapped");
}

TEST_F(CampaignTest, HasTheSameBytesUnderMpi) {
  if (std::system("command -v mpirun > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "mpirun is not installed (Debian: openmpi-bin)";
  const std::string list = WriteList();
  Lamina(Arguments(list, "alone"));
  const std::string said = InRanks(2, Arguments(list, "ranks"));
  if (said.find("built without MPI") != std::string::npos)
    GTEST_SKIP() << "the program was built without MPI (Debian: libopenmpi-dev)";
  ASSERT_TRUE(fs::exists(Path("ranks/campaign.json"))) << said;
  EXPECT_EQ(Figures("ranks")["ranks"], 2);
  ExpectSame("alone", "ranks");
}

TEST_F(CampaignTest, KeyframesAreAdjustedTogetherWithTheSameBytes) {
  const std::string list = WriteList();
  const Outcome alone = Lamina(ByKeyframes(list, "alone"));
  ASSERT_TRUE(fs::exists(Path("alone/map/summary.json"))) << alone.err;
  EXPECT_TRUE(fs::exists(Path("alone/drives/first/keyframes.bin")));
  const nlohmann::json frames =
      nlohmann::json::parse(Bytes(Path("alone/map/summary.json")))["keyframes"];
  ASSERT_EQ(frames.size(), 1U);
  EXPECT_GT(frames[0]["keyframes"], 40);
  EXPECT_GT(frames[0]["tiles"], 2);
  EXPECT_LT(frames[0]["rounds"][0]["cost"], frames[0]["rounds"][0]["cost_before"]);
  // Of the same drives, which have no keyframes then, by submaps alone.
  Lamina(Arguments(list, "submaps"));
  EXPECT_EQ(Bytes(Path("alone/drives/first/submaps.bin")),
            Bytes(Path("submaps/drives/first/submaps.bin")));
  EXPECT_NE(Bytes(Path("alone/map/submaps.bin")), Bytes(Path("submaps/map/submaps.bin")));
  // What is there is kept; the drives that lack their keyframes are mapped again.
  EXPECT_THAT(Lamina(ByKeyframes(list, "alone")).out, HasSubstr("their map is there already"));
  Lamina(ByKeyframes(list, "submaps"));
  ExpectSame("alone", "submaps");
  if (std::system("command -v mpirun > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "mpirun is not installed (Debian: openmpi-bin)";
  const std::string said = InRanks(3, ByKeyframes(list, "ranks"));
  if (said.find("built without MPI") != std::string::npos)
    GTEST_SKIP() << "the program was built without MPI (Debian: libopenmpi-dev)";
  ASSERT_TRUE(fs::exists(Path("ranks/campaign.json"))) << said;
  ExpectSame("alone", "ranks");
}

TEST_F(CampaignTest, WrongUseIsSaid) {
  const std::string list = Write("list.yaml", "recordings:\n  - none\n");
  const Outcome none = Lamina(Arguments(list, "out"));
  EXPECT_EQ(none.code, 1);
  EXPECT_THAT(none.err, HasSubstr("not one of the recordings could be mapped"));
  EXPECT_EQ(Lamina(Arguments(Write("wrong.yaml", "recording:\n"), "out")).code, 2);
  const std::string scans = WriteRecording("scans", Street(2));
  std::vector<std::string> level = Arguments(list, "out");
  level.insert(level.end(), {"--level", "points"});
  EXPECT_EQ(Lamina(level).code, 2);
  level.back() = "keyframes";
  level.insert(level.end(), {"--tile-size", "0"});
  EXPECT_EQ(Lamina(level).code, 2);
  const Outcome within =
      Lamina(Arguments(Write("within.yaml", "recordings:\n  - scans\n"), "scans/out"));
  EXPECT_EQ(within.code, 2);
  EXPECT_THAT(within.err, HasSubstr("is in the folder of the recording"));
}

TEST(DealOut, TheLargestFirstToWhoHasLeast) {
  EXPECT_EQ(DealOut({5, 9, 4, 1}, 2), (std::vector<std::size_t>{1, 0, 1, 0}));
  EXPECT_EQ(DealOut({0, 0, 0}, 3), (std::vector<std::size_t>{0, 1, 2}));
  EXPECT_EQ(DealOut({7}, 4), (std::vector<std::size_t>{0}));
}

}  // namespace
}  // namespace lamina
