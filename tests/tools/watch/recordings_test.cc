// Bags, MCAP files and captures in the inbox.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "tests/support/files/container_files.h"
#include "tests/support/files/swept_messages.h"
#include "tests/support/program/watch_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

using testing::AllOf;
using testing::HasSubstr;

class WatchRecordingsTest : public WatchTest {
 protected:
  static std::string Bag(const std::string& other = "") {
    return BagBytes(SweptMessages(WireWriter::Form::kRos1, other), {"lz4", 4, true});
  }
  static std::string Mcap() { return McapBytes(SweptMessages(WireWriter::Form::kCdr), {}); }
};

TEST_F(WatchRecordingsTest, ARecordingInOneFileGivesWhatRunGives) {
  const std::string bag = Write("in/a.bag", Bag());
  EXPECT_EQ(Lamina({"run", "--scans", bag, "--out", Path("run")}).code, 0);
  const Outcome outcome = Once();
  EXPECT_THAT(outcome.err, HasSubstr("a.bag: is a recording, of which all 12 scans were taken"));
  ExpectSameResults("session", "run");
  const auto mapped = TimesMapped(Path("session/session.db"));
  EXPECT_EQ(mapped.size(), 12U);
  EXPECT_EQ(mapped.count("a.bag#11"), 1U);
  // Nothing is left of it, and it is no late file.
  EXPECT_THAT(Once().err, testing::Not(HasSubstr("is a recording")));
  EXPECT_EQ(Summary("session")["late_files"], 0);
  EXPECT_EQ(Summary("session")["frames"], 12);
}

TEST_F(WatchRecordingsTest, EachIsARecordingOfItsOwnAndScansAreDurableOneByOne) {
  fs::create_directories(Path("in/ros2"));
  WriteDatabase(Path("in/ros2/ros2_0.db3"), SweptMessages(WireWriter::Form::kCdr));
  const pid_t daemon = StartWatch();
  Drop("a.bag", Bag());
  ASSERT_TRUE(WaitForScans(daemon, 12));
  Drop("b.mcap", Mcap());
  ASSERT_TRUE(WaitForScans(daemon, 24));
  // The database of a ROS 2 bag waits for what its recorder writes last.
  Drop("ros2/metadata.yaml", Metadata({"ros2_0.db3"}));
  ASSERT_TRUE(WaitForScans(daemon, 36));
  Terminate(daemon);
  EXPECT_EQ(Summary("session")["pieces"].size(), 3U);
  EXPECT_EQ(TimesMapped(Path("session/session.db")).count("ros2/metadata.yaml#3"), 1U);
}

TEST_F(WatchRecordingsTest, WithoutAChosenTopicABagOfSeveralIsRefused) {
  Drop("a.bag", Bag("/rear"));
  const Outcome outcome = Once();
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("a.bag: refused"), HasSubstr("--topic")));
  EXPECT_THAT(Bytes(Path("session/rejected/a.bag.reason.txt")), HasSubstr("2 topics of scans"));
  fs::remove_all(Path("session"));
  Once({"--topic", "/rear"});
  EXPECT_EQ(Summary("session")["frames"], 12);
}

TEST_F(WatchRecordingsTest, ADamagedScanIsRejectedAndTheRestMapped) {
  RecordedMessages recorded = SweptMessages(WireWriter::Form::kRos1);
  recorded.messages[9].bytes.resize(100);  // that of scan 4
  Drop("a.bag", BagBytes(recorded, {"none", 1, true}));
  const Outcome outcome = Once();
  EXPECT_EQ(Summary("session")["frames"], 11);
  EXPECT_THAT(outcome.err, HasSubstr("skipped scan 4"));
  EXPECT_THAT(Bytes(Path("session/rejected/a.bag#4.reason.txt")), HasSubstr("a.bag#4"));
}

TEST_F(WatchRecordingsTest, FilesGoWhenAllTheirScansAreSafe) {
  const Arguments often{"--set", "session.checkpoint_every_scans=3", "--done", "move"};
  fs::create_directories(Path("in/ros2"));
  WriteDatabase(Path("in/ros2/ros2_0.db3"), SweptMessages(WireWriter::Form::kCdr));
  Drop("ros2/metadata.yaml", Metadata({"ros2_0.db3"}));
  Drop("a.bag", Bag());
  Once(often);
  // The last of them stays as long as a checkpoint may need it.
  Drop("z.mcap", Mcap());
  Once(often);
  EXPECT_FALSE(fs::exists(Path("in/a.bag")));
  EXPECT_FALSE(fs::exists(Path("in/ros2/ros2_0.db3")));
  EXPECT_TRUE(Bytes(Path("session/done/a.bag")) == Bag());
  EXPECT_TRUE(fs::exists(Path("session/done/ros2/metadata.yaml")));
}

}  // namespace
}  // namespace lamina
