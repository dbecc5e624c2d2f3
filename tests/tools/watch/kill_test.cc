// A session whose daemon is killed, at any moment and any number of times, ends as one never
// disturbed.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <random>
#include <set>
#include <string>

#include "tests/support/files/container_files.h"
#include "tests/support/files/swept_messages.h"
#include "tests/support/program/watch_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

class WatchKillTest : public WatchTest {
 protected:
  // LAMINA_SEED repeats a failure.
  WatchKillTest()
      : seed_(std::getenv("LAMINA_SEED") != nullptr
                  ? static_cast<unsigned>(std::atoll(std::getenv("LAMINA_SEED")))
                  : std::random_device{}()),
        random_(seed_) {
    std::printf("LAMINA_SEED=%u\n", seed_);
  }

  int Random(int below) { return std::uniform_int_distribution<int>(0, below - 1)(random_); }

  // Drops in 31 scans of two drives, of which three are unusable.
  void DropTwoDrives() {
    Recording street = Street(28);
    street[6].bytes.resize(1000);
    street[22].bytes.clear();
    street[23].bytes.resize(17);
    WriteRecording("in/a", {street.begin(), street.begin() + 17});
    WriteRecording("in/b", {street.begin() + 14, street.end()});
  }

  // What a power cut or a kill has left, looked at in a copy: looking may change it.
  void ExpectCleanDatabase() {
    if (!fs::exists(Path("session/session.db"))) return;
    fs::remove_all(Path("copy"));
    fs::create_directories(Path("copy"));
    for (const char* name : {"session.db", "session.db-wal"}) {
      if (fs::exists(Path(std::string("session/") + name))) {
        fs::copy(Path(std::string("session/") + name), Path(std::string("copy/") + name));
      }
    }
    for (const auto& [file, times] : TimesMapped(Path("copy/session.db"))) {
      EXPECT_EQ(times, 1) << file;
    }
  }

  // Lets the daemon run until it has written so often, then sends the signal. False if it had ended
  // by itself.
  bool Disturb(Arguments more, int writes, int signal) {
    FolderEvents events(Path("session"));
    more.emplace_back("--once");
    const pid_t child = StartWatch(more);
    const bool disturbed = events.CountUntilEnd(child, writes) == writes;
    kill(child, signal);
    const Outcome outcome = WaitFor(child);
    // It may end by itself just as the signal comes.
    EXPECT_TRUE(outcome.code == 0 || (outcome.code == -1 && signal == SIGKILL)) << outcome.err;
    return disturbed;
  }

  // Of a session "whole" that is not disturbed.
  int WritesOf(const Arguments& more) {
    FolderEvents events(Path("whole"));
    Arguments arguments = more;
    arguments.emplace_back("--once");
    const pid_t child = StartWatch(arguments, "whole");
    const int writes = events.CountUntilEnd(child, 1 << 30);
    EXPECT_EQ(WaitFor(child).code, 0);
    return writes;
  }

  const unsigned seed_;
  std::mt19937 random_;
};

TEST_F(WatchKillTest, KilledAtRandomMomentsItEndsAsIfNothingHadHappened) {
  DropTwoDrives();
  const Arguments often{"--set", "session.checkpoint_every_scans=6", "--set",
                        "session.trajectory_period_s=0.01"};
  const int writes = WritesOf(often);
  ASSERT_GT(writes, 100);
  for (int kills = 0; kills < 8; ++kills) {
    if (!Disturb(often, 1 + Random(writes * 2 / 3), SIGKILL)) break;
    ExpectCleanDatabase();
  }
  Once(often);
  ExpectSameResults("session", "whole");
  const auto mapped = TimesMapped(Path("session/session.db"));
  EXPECT_EQ(mapped.size(), 31U);
  for (const auto& [file, times] : mapped) EXPECT_EQ(times, 1) << file;
  EXPECT_EQ(mapped, TimesMapped(Path("whole/session.db")));
}

TEST_F(WatchKillTest, SoItDoesWhenTheMapIsOnDisk) {
  ASSERT_EQ(Lamina({"synth", "--out", Path("in"), "--sensor", "vlp16", "--frames", "90", "--route",
                    "straight"})
                .code,
            0);
  const Arguments often{"--set", "session.checkpoint_every_scans=15", "--set", "map.budget_mb=2.2"};
  const int writes = WritesOf(often);
  EXPECT_GT(Summary("whole")["stored_voxels"], 0);
  for (int kills = 0; kills < 4; ++kills) {
    if (!Disturb(often, 1 + Random(writes * 2 / 3), SIGKILL)) break;
    ExpectCleanDatabase();
  }
  Once(often);
  ExpectSameResults("session", "whole");
}

TEST_F(WatchKillTest, SoItDoesInTheMidstOfRecordingsInOneFile) {
  const RecordedMessages ros1 = SweptMessages(WireWriter::Form::kRos1);
  Write("in/a.bag", BagBytes(ros1, {"bz2", 4, true}));
  // Its recorder died: it has no index.
  Write("in/b.bag", BagBytes(ros1, {"lz4", 5, false}));
  Write("in/c/c.mcap", McapBytes(SweptMessages(WireWriter::Form::kCdr), {}));
  WriteRecording("in/street", Street(10));
  Arguments often{"--set", "session.checkpoint_every_scans=5"};
  const int writes = WritesOf(often);
  often.insert(often.end(), {"--done", "delete"});
  for (int kills = 0; kills < 6; ++kills) {
    if (!Disturb(often, 1 + Random(writes * 2 / 3), SIGKILL)) break;
    ExpectCleanDatabase();
  }
  Once(often);
  ExpectSameResults("session", "whole");
  EXPECT_EQ(TimesMapped(Path("session/session.db")).size(), 46U);
  EXPECT_FALSE(fs::exists(Path("in/a.bag")));
}

TEST_F(WatchKillTest, TerminatedItContinuesToTheSame) {
  DropTwoDrives();
  const Arguments often{"--set", "session.checkpoint_every_scans=10"};
  const int writes = WritesOf(often);
  for (int ends = 0; ends < 3; ++ends) {
    // Before its handler stands the signal ends the program, as SIGKILL would.
    Disturb(often, 40 + Random(writes / 3), SIGTERM);
  }
  Once(often);
  ExpectSameResults("session", "whole");
}

TEST_F(WatchKillTest, FilesThatAreMovedOrDeletedAreNeverNeededAgain) {
  const Recording street = Street(28);
  WriteRecording("in", street);
  const Arguments checkpoints{"--set", "session.checkpoint_every_scans=5"};
  const int writes = WritesOf(checkpoints);
  for (const char* done : {"move", "delete"}) {
    fs::remove_all(Path("in"));
    fs::remove_all(Path("session"));
    WriteRecording("in", street);
    Arguments often = checkpoints;
    often.insert(often.end(), {"--done", done});
    std::set<std::string> gone;
    for (int kills = 0; kills < 5; ++kills) {
      if (!Disturb(often, 1 + Random(writes), SIGKILL)) break;
      // Where a scan's file has gone, it is mapped.
      const auto there = FilesIn("in");
      if (!fs::exists(Path("session/session.db"))) continue;
      const auto mapped = TimesMapped(Path("session/session.db"));
      for (std::size_t i = 0; i < street.size(); ++i) {
        const std::string name = "velodyne/" + ScanName(i);
        if (std::binary_search(there.begin(), there.end(), name)) continue;
        EXPECT_EQ(mapped.count(name), 1U) << name;
        // Moved files lie there for people alone.
        if (gone.insert(name).second && std::string(done) == "move") {
          EXPECT_TRUE(Bytes(Path("session/done/" + name)) == street[i].bytes) << name;
        }
      }
      fs::remove_all(Path("session/done"));
    }
    Once(often);
    EXPECT_LT(FilesIn("in").size(), street.size()) << "nothing was " << done << "d";
    ExpectSameResults("session", "whole");
  }
}

}  // namespace
}  // namespace lamina
