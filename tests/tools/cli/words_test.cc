// Words of a command line that the program has no use for, configurations by name, and what is said
// of a recording.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/program/run_helpers.h"
#include "tools/cli/repeated_lines.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

namespace fs = std::filesystem;

class WordsTest : public RunTest {
 protected:
  // What is said of a command line that is refused.
  std::string WrongUsage(const std::vector<std::string>& arguments) const {
    const Outcome outcome = Lamina(arguments);
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    return outcome.err;
  }
};

TEST_F(WordsTest, UnknownCommandsAndOptionsAreNamed) {
  EXPECT_THAT(WrongUsage({"rnu"}),
              AllOf(HasSubstr("unknown command 'rnu'; did you mean 'run'?"), HasSubstr("export")));
  EXPECT_THAT(WrongUsage({"fly"}), AllOf(HasSubstr("'fly'"), Not(HasSubstr("did you mean"))));
  EXPECT_THAT(WrongUsage({"run", "--scan", "x", "--out", "y"}),
              HasSubstr("lamina run: unknown option '--scan'; did you mean '--scans'?"));
  EXPECT_THAT(WrongUsage({"run", "--scans", "x", "--output=y"}),
              HasSubstr("did you mean '--out'?"));
  EXPECT_THAT(WrongUsage({"run", "--scans", "x", "-o", "y"}), HasSubstr("did you mean '--out'?"));
  EXPECT_THAT(WrongUsage({"watch", "--input", "x"}), HasSubstr("did you mean '--inbox'?"));
  EXPECT_THAT(WrongUsage({"run", "--scans", "x", "--out", "y", "--gt", "z"}),
              HasSubstr("did you mean '--truth'?"));
  EXPECT_THAT(WrongUsage({"run", "/data/07"}), HasSubstr("did you mean --scans /data/07?"));
  EXPECT_THAT(WrongUsage({"run", "--scans", "a", "b", "--out", "c"}), HasSubstr("takes 'b'"));
  EXPECT_THAT(WrongUsage({"--verion"}), HasSubstr("did you mean '--version'?"));
  EXPECT_THAT(WrongUsage({"run", "--set", "a=1", "b=2", "--out", "x", "--scans", "y"}),
              HasSubstr("no option takes 'b=2'"));
}

TEST_F(WordsTest, WordsThatAreRightPass) {
  const Outcome version = Lamina({"--version"});
  EXPECT_EQ(version.code, 0);
  EXPECT_THAT(version.out, testing::MatchesRegex("lamina [0-9]+\\.[0-9]+\\.[0-9]+\n"));
  EXPECT_EQ(Lamina({"run", "--help"}).code, 0);
  const Outcome merge = Lamina({"merge", Path("a"), Path("b"), Path("c"), "--out", Path("d")});
  EXPECT_EQ(merge.code, 1);
  EXPECT_THAT(merge.err, AllOf(HasSubstr(Path("a")), Not(HasSubstr("no option takes"))));
  // Negative numbers are values.
  EXPECT_THAT(Lamina({"watch", "--inbox", Path("none"), "--session", Path("s"), "--mode",
                      "localise", "--map", Path("m"), "--start", "-1", "-2.5", "0"})
                  .err,
              HasSubstr("inbox must be a folder"));
}

TEST_F(WordsTest, ShippedConfigurationsGoByName) {
  const Outcome list = Lamina({"config"});
  EXPECT_EQ(list.code, 0);
  std::size_t shipped = 0;
  for (const auto& entry : fs::directory_iterator(LAMINA_SOURCE_DIR "/config")) {
    if (entry.path().extension() != ".yaml") continue;
    ++shipped;
    const std::string name = entry.path().stem().string();
    EXPECT_THAT("\n" + list.out, HasSubstr("\n" + name + " "));
    EXPECT_EQ(Lamina({"config", name}).out, Bytes(entry.path().string()));
  }
  EXPECT_GE(shipped, 4U);
  EXPECT_THAT(list.out, HasSubstr("KITTI raw drives"));
  EXPECT_THAT(WrongUsage({"config", "kitti"}), HasSubstr("did you mean kitti_odometry?"));
  EXPECT_EQ(Lamina({"config", "livox_avia", "--out", Path("my.yaml")}).code, 0);
  EXPECT_THAT(Bytes(Path("my.yaml")), HasSubstr("min_range_m: 0.5"));
  EXPECT_THAT(WrongUsage({"config", "livox_avia", "--out", Path("my.yaml")}),
              HasSubstr("is there already"));

  const std::string scans = WriteRecording("street", Street(2));
  // From a copy of the program alone, in a folder without anything.
  fs::copy_file(LAMINA_PROGRAM, Path("copy"));
  const std::string command = "cd " + Path("") +
                              " && ./copy run --scans street --out out "
                              "--config livox_avia > /dev/null 2>&1";
  EXPECT_EQ(std::system(command.c_str()), 0);
  EXPECT_THAT(Bytes(Path("out/config.yaml")), HasSubstr("min_range_m: 0.5"));
  EXPECT_THAT(Run(scans, {"--config", "kiti_raw"}, 1, "none").err,
              AllOf(HasSubstr("no configuration kiti_raw"), HasSubstr("did you mean kitti_raw?")));
  EXPECT_THAT(Run(scans, {"--config", "elsewhere/kitti_raw.yaml"}, 1, "none").err,
              HasSubstr("did you mean kitti_raw?"));
}

TEST_F(WordsTest, ScansOneFolderDownAreFound) {
  const Recording street = Street(3);
  for (std::size_t i = 0; i < street.size(); ++i) {
    Write("drive/lidar/" + ScanName(i), street[i].bytes);
  }
  EXPECT_THAT(Run(Path("drive"), {}, 1).err,
              AllOf(HasSubstr("holds no scans"), HasSubstr(Path("drive/lidar") + " holds 3")));
  EXPECT_THAT(Run(Path("."), {}, 1).err, HasSubstr(Path("./drive/lidar") + " holds 3"));

  // Stamps beside the folder: a line for each scan, or it is said that they are not.
  Write("drive/times.txt", "5.0\n5.2\n5.4\n");
  EXPECT_THAT(Run(Path("drive/lidar")).err, AllOf(HasSubstr("drive/times.txt"), HasSubstr("5 Hz")));
  EXPECT_THAT(Bytes(Path("out/frames.csv")), HasSubstr("\n2,5.400000000,"));
  Write("drive/times.txt", "5.0\n5.2\n");
  EXPECT_THAT(
      Run(Path("drive/lidar"), {}, 0, "other").err,
      AllOf(HasSubstr("drive/times.txt is not used: 2 stamps for 3 scans"), HasSubstr("made up")));
  EXPECT_THAT(Bytes(Path("other/frames.csv")), HasSubstr("\n2,0.200000000,"));
}

TEST_F(WordsTest, ASessionGoesOnWithItsOwnOptions) {
  const std::string scans = WriteRecording("street", Street(4));
  const std::vector<std::string> watch{"watch",         "--inbox", scans,    "--session",
                                       Path("session"), "--once",  "--http", "off"};
  std::vector<std::string> begin = watch;
  begin.insert(begin.end(), {"--config", "kitti_raw"});
  ASSERT_EQ(Lamina(begin).code, 0);
  const std::string config = Bytes(Path("session/config.yaml"));
  const Outcome again = Lamina(watch);
  EXPECT_EQ(again.code, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr(Path("session/config.yaml")));
  EXPECT_EQ(Bytes(Path("session/config.yaml")), config);
}

TEST(RepeatedLines, AreCounted) {
  RepeatedLines lines;
  std::vector<std::string> shown;
  for (int i = 1; i <= 1000; ++i) {
    if (const auto line = lines.Next("lost", "lost at " + std::to_string(i)))
      shown.push_back(*line);
  }
  ASSERT_EQ(shown.size(), 16U);
  EXPECT_EQ(shown[8], "lost at 9");
  EXPECT_THAT(shown[9], HasSubstr("lost at 10 (the 10th"));
  EXPECT_THAT(shown[10], HasSubstr("lost at 20 (the 20th of its kind; the 9 before it"));
  EXPECT_THAT(shown[15], HasSubstr("lost at 1000 (the 1000th of its kind; the 499 before"));
  EXPECT_EQ(lines.Next("skipped", "skipped 4"), "skipped 4");
}

}  // namespace
}  // namespace lamina
