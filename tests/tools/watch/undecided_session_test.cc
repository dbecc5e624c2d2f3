// What the first scans of a session decide where no configuration was named.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <string>

#include "tests/support/program/watch_scenes.h"
#include "tools/watch/files.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

class WatchUndecidedTest : public WatchTest {
 protected:
  static constexpr std::size_t kScans = 26;

  // A small place, for which the defaults are too coarse.
  void DropRoom(std::size_t from, std::size_t to) const {
    static const Recording room = SyntheticRecording(synth::SceneKind::kRoom, kScans, 3);
    DropScans(room, from, to);
  }
  std::string ConfigOf(const std::string& session) const {
    return Bytes(Path(session + "/config.yaml"));
  }
  bool Undecided() const { return fs::exists(Path("session/undecided")); }
  void ExpectAsNamed() {
    Once({"--config", "handheld"}, 0, "named");
    EXPECT_EQ(ConfigOf("session"), ConfigOf("named"));
    ExpectSameResults("session", "named");
    EXPECT_FALSE(Undecided());
  }
  // A daemon that has mapped some of the first scans.
  pid_t BeginWith(std::size_t scans, const Arguments& more = {}) {
    DropRoom(0, scans);
    const pid_t daemon = StartWatch(more);
    EXPECT_TRUE(WaitForScans(daemon, static_cast<std::int64_t>(scans)));
    EXPECT_TRUE(Undecided());
    return daemon;
  }
};

TEST_F(WatchUndecidedTest, ASmallPlaceIsMappedAsIfItHadBeenAskedFor) {
  DropRoom(0, kScans);
  EXPECT_THAT(Once().err, HasSubstr("a small place, nine points of ten within"));
  ExpectAsNamed();
  EXPECT_THAT(Once().err, Not(HasSubstr("begins anew")));
}

TEST_F(WatchUndecidedTest, FewScansDecideWhenNoMoreAreToCome) {
  DropRoom(0, 8);
  EXPECT_THAT(Once().err, HasSubstr("begins anew"));
  DropRoom(8, kScans);
  Once();
  ExpectAsNamed();
}

TEST_F(WatchUndecidedTest, WhatAsksForNothingElseGoesOn) {
  DropScans(Street(24), 0, 24);
  EXPECT_THAT(Once().err, Not(HasSubstr("begins anew")));
  EXPECT_FALSE(Undecided());
}

TEST_F(WatchUndecidedTest, EndedOrKilledBeforeItBeginsAnewAsWell) {
  const pid_t killed = BeginWith(10);
  kill(killed, SIGKILL);
  WaitFor(killed);
  DropRoom(10, 15);
  const pid_t ended = StartWatch();
  ASSERT_TRUE(WaitForScans(ended, 15));
  Terminate(ended);
  EXPECT_TRUE(Undecided());
  DropRoom(15, kScans);
  Once();
  ExpectAsNamed();
}

TEST_F(WatchUndecidedTest, KilledWhileItIsClearedItIsClearedAgain) {
  const pid_t daemon = BeginWith(10);
  Terminate(daemon);
  // All but the database has gone.
  for (const auto& entry : fs::directory_iterator(Path("session"))) {
    const std::string name = entry.path().filename().string();
    if (name != "undecided" && name != "session.db") fs::remove_all(entry.path());
  }
  DropRoom(10, kScans);
  Once();
  ExpectAsNamed();
}

TEST_F(WatchUndecidedTest, WhereFilesHaveGoneItGoesOnAsItBegan) {
  const Arguments move{"--done", "move"};
  Terminate(BeginWith(10, move));
  {
    SessionDatabase database(Path("session/session.db"), false);
    SetFilesDoneUpTo(1, &database);
  }
  DropRoom(10, kScans);
  Once(move);
  EXPECT_FALSE(Undecided());
  EXPECT_THAT(ConfigOf("session"), HasSubstr("root_size_m: 1.6\n"));
  EXPECT_EQ(TimesMapped(Path("session/session.db")).size(), kScans);
}

// What was rejected before is rejected again.
TEST_F(WatchUndecidedTest, ScansThatCannotBeReadAreRejectedOnce) {
  Recording room = SyntheticRecording(synth::SceneKind::kRoom, kScans, 3);
  room[3].bytes.resize(1000);
  DropScans(room, 0, 10);
  const pid_t daemon = StartWatch({"--done", "move"});
  ASSERT_TRUE(WaitForScans(daemon, 10));
  ASSERT_TRUE(WaitUntil(daemon, [&] { return FilesIn("session/rejected").size() == 2; }));
  DropScans(room, 10, kScans);
  ASSERT_TRUE(WaitForScans(daemon, kScans));
  Terminate(daemon);
  EXPECT_EQ(FilesIn("session/rejected").size(), 2U);
  EXPECT_THAT(ConfigOf("session"), HasSubstr("root_size_m: 2\n"));
  const SessionDatabase database(Path("session/session.db"), true);
  std::size_t skipped = 0;
  database.ForEach(0, database.scans(),
                   [&](const ScanRecord& scan) { skipped += scan.skipped ? 1 : 0; });
  EXPECT_EQ(skipped, 1U);
}

TEST_F(WatchUndecidedTest, ANamedConfigurationStays) {
  DropRoom(0, kScans);
  EXPECT_THAT(Once({"--config", "default"}).err,
              HasSubstr("a session begun with --config handheld maps it better"));
  EXPECT_THAT(ConfigOf("session"), HasSubstr("root_size_m: 1.6\n"));
  EXPECT_FALSE(Undecided());
}

}  // namespace
}  // namespace lamina
