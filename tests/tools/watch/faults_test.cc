// Sessions under misfortune: in use, read-only, on a full disk, damaged.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/support/files/small_disk.h"
#include "tests/support/program/watch_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

using testing::AllOf;
using testing::HasSubstr;

class WatchFaultsTest : public WatchTest {
 protected:
  // LAMINA_DISK_FULL_POINTS, for a long trial; a few otherwise.
  static int PointsToFillAt() {
    const char* const points = std::getenv("LAMINA_DISK_FULL_POINTS");
    return points != nullptr ? std::stoi(points) : 3;
  }

  // Newest first.
  std::vector<std::string> Checkpoints() const {
    std::vector<std::pair<int, std::string>> found;
    for (const std::string& name : FilesIn("session")) {
      int scans = 0;
      if (std::sscanf(name.c_str(), "checkpoint-%d.lmap", &scans) == 1) {
        found.emplace_back(-scans, Path("session/" + name));
      }
    }
    std::sort(found.begin(), found.end());
    std::vector<std::string> paths;
    for (const auto& [scans, path] : found) paths.push_back(path);
    return paths;
  }

  static void Flip(const std::string& path, double place) {
    std::string bytes = Bytes(path);
    ASSERT_FALSE(bytes.empty()) << path;
    auto& byte = bytes[static_cast<std::size_t>(place * static_cast<double>(bytes.size() - 1))];
    byte = static_cast<char>(byte ^ 0x5a);
    std::ofstream(path, std::ios::binary) << bytes;
  }

  static constexpr std::size_t kScans = 26;

  // A session of the first 18 scans of the street, stopped; all of them are in the inbox then, and
  // the folder "whole" has an undisturbed session of them.
  void MakeHalfSession(const Arguments& options) {
    constexpr std::size_t kFirst = 18;
    const Recording street = Street(kScans);
    DropScans(street, 0, kScans);
    Once({options.begin(), options.begin() + 2}, 0, "whole");
    fs::remove_all(Path("in"));
    fs::create_directories(Path("in/velodyne"));
    DropScans(street, 0, kFirst);
    Once(options);
    DropScans(street, kFirst, kScans);
  }
};

TEST_F(WatchFaultsTest, ASessionInUseIsLeftAlone) {
  DropScans(Street(8), 0, 4);
  const pid_t daemon = StartWatch();
  ASSERT_TRUE(WaitForScans(daemon, 4));
  const Outcome second = Once({}, 1);
  EXPECT_THAT(second.err, AllOf(HasSubstr("lamina: error: "),
                                HasSubstr("in use by process " + std::to_string(daemon))));
  DropScans(Street(8), 4, 8);
  ASSERT_TRUE(WaitForScans(daemon, 8));
  Terminate(daemon);
  // The lock goes with the process.
  Once();
  EXPECT_EQ(Summary("session")["frames"], 8);
}

TEST_F(WatchFaultsTest, AReadOnlySessionIsAClearError) {
  if (!kOwnMounts) GTEST_SKIP() << "only root can mount";
  DropScans(Street(4), 0, 4);
  Once();
  const std::string session = Path("session");
  ASSERT_EQ(mount(session.c_str(), session.c_str(), nullptr, MS_BIND, nullptr), 0);
  ASSERT_EQ(mount(nullptr, session.c_str(), nullptr, MS_BIND | MS_REMOUNT | MS_RDONLY, nullptr), 0);
  const Outcome outcome = Once({}, 1);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("lamina: error: "), HasSubstr(session),
                                 HasSubstr("ead-only file system")));
  ASSERT_EQ(umount(session.c_str()), 0);
  Once();
}

TEST_F(WatchFaultsTest, WithAFullDiskItWaitsAndGoesOnByItself) {
  const Arguments often{"--set", "session.checkpoint_every_scans=5"};
  DropScans(Street(kScans), 0, 6);
  const SmallDisk disk(Path("session"), 64 << 20);
  if (!disk.mounted()) GTEST_SKIP() << "only root can mount";
  const pid_t daemon = StartWatch(often);
  ASSERT_TRUE(WaitForScans(daemon, 6));
  disk.Fill();
  DropScans(Street(kScans), 6, kScans);
  ASSERT_TRUE(WaitUntil(daemon, [&] { return Said("the disk is full"); }));
  EXPECT_THAT(Bytes(Path("stderr")), AllOf(HasSubstr("bytes are free"), HasSubstr("are needed")));
  disk.Empty();
  ASSERT_TRUE(WaitForScans(daemon, kScans));
  Terminate(daemon);
  Once(often, 0, "whole");
  ExpectSameResults("session", "whole");
}

TEST_F(WatchFaultsTest, AWaitForRoomCanBeEnded) {
  DropScans(Street(8), 0, 4);
  const SmallDisk disk(Path("session"), 64 << 20);
  if (!disk.mounted()) GTEST_SKIP() << "only root can mount";
  Once();
  disk.Fill();
  DropScans(Street(8), 4, 8);
  const pid_t daemon = StartWatch();
  ASSERT_TRUE(WaitUntil(daemon, [&] { return Said("the disk is full"); }));
  kill(daemon, SIGTERM);
  const Outcome outcome = WaitFor(daemon);
  EXPECT_THAT(outcome.err, HasSubstr(Path("session")));
  EXPECT_GE(outcome.code, 0) << "not by the signal";
  disk.Empty();
  Once();
  Once({}, 0, "whole");
  ExpectSameResults("session", "whole");
}

// The signal comes before the wait is over, and after there is room.
TEST_F(WatchFaultsTest, AWaitForRoomThatIsEndedWhenThereIsRoomIsNoFailure) {
  DropScans(Street(8), 0, 4);
  const SmallDisk disk(Path("session"), 64 << 20);
  if (!disk.mounted()) GTEST_SKIP() << "only root can mount";
  Once();
  disk.Fill();
  DropScans(Street(8), 4, 8);
  const pid_t daemon = StartWatch();
  ASSERT_TRUE(WaitUntil(daemon, [&] { return Said("the disk is full"); }));
  disk.Empty();
  EXPECT_EQ(Terminate(daemon).code, 0);
  Once();
  EXPECT_EQ(Summary("session")["frames"], 8);
}

// The disk fills up in the midst of everything, each time at another point.
TEST_F(WatchFaultsTest, WhereverTheDiskFillsUpTheResultIsTheSame) {
  const Arguments often{"--set",  "session.checkpoint_every_scans=4",
                        "--set",  "session.trajectory_period_s=0.05",
                        "--done", "move"};
  DropScans(Street(kScans), 0, kScans);
  const std::string inbox = Path("in");
  fs::copy(inbox, Path("kept"), fs::copy_options::recursive);
  Once({often.begin(), often.begin() + 4}, 0, "whole");
  const int points = PointsToFillAt();
  for (int i = 0; i < points; ++i) {
    SCOPED_TRACE(i);
    fs::remove_all(inbox);
    fs::copy(Path("kept"), inbox, fs::copy_options::recursive);
    const SmallDisk disk(Path("session"), 256 << 20);
    if (!disk.mounted()) GTEST_SKIP() << "only root can mount";
    const pid_t daemon = StartWatch(often);
    ASSERT_TRUE(WaitForScans(daemon, 1 + i * static_cast<int>(kScans - 1) / points));
    disk.Fill();
    ASSERT_TRUE(WaitUntil(daemon, [&] { return Said("the disk is full"); }));
    for (const std::string& name : FilesIn("session")) {
      // Whatever is being written at this moment aside, which is removed within the next, and the
      // second copies of the trajectory files, which last as long as the daemon.
      if (name.find(".partial") == std::string::npos || name.rfind("trajectory_", 0) == 0) continue;
      EXPECT_TRUE(WaitUntil(daemon, [&] { return !fs::exists(Path("session/" + name)); })) << name;
    }
    disk.Empty();
    ASSERT_TRUE(WaitForScans(daemon, kScans));
    Terminate(daemon);
    EXPECT_THAT(FilesIn("session"), testing::Each(testing::Not(HasSubstr(".partial"))));
    ExpectSameResults("session", "whole");
  }
}

TEST_F(WatchFaultsTest, ADamagedCheckpointLeadsToTheOneBefore) {
  const Arguments often{"--set", "session.checkpoint_every_scans=5", "--done", "delete"};
  MakeHalfSession(often);
  const auto checkpoints = Checkpoints();
  ASSERT_GE(checkpoints.size(), 2U);
  Flip(checkpoints[0], 0.6);
  const Outcome outcome = Once(often);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr(checkpoints[0]), HasSubstr("damaged"),
                                 HasSubstr("going back to the checkpoint before it")));
  ExpectSameResults("session", "whole");
}

TEST_F(WatchFaultsTest, WithoutAnyCheckpointAllIsMappedAgain) {
  const Arguments often{"--set", "session.checkpoint_every_scans=5"};
  MakeHalfSession(often);
  for (const std::string& path : Checkpoints()) fs::resize_file(path, fs::file_size(path) / 2);
  EXPECT_THAT(Once(often).err, HasSubstr("all scans are mapped again"));
  ExpectSameResults("session", "whole");
}

TEST_F(WatchFaultsTest, ADamagedDatabaseLeadsToItsCopy) {
  const Arguments often{"--set", "session.checkpoint_every_scans=2", "--done", "delete"};
  MakeHalfSession(often);
  ASSERT_LT(FilesIn("in").size(), kScans + 1) << "no file was deleted";
  Write("session/session.db", std::string(100000, 'x'));
  const Outcome outcome = Once(often);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("session.db: is damaged"),
                                 HasSubstr("going back to the copy of the last checkpoint")));
  ExpectSameResults("session", "whole");
  EXPECT_TRUE(fs::exists(Path("session/session.db.damaged")));
  // Neither of both: nothing can be made up.
  Write("session/session.db", std::string(100000, 'x'));
  Write("session/session.db.backup", std::string(100000, 'x'));
  EXPECT_THAT(Once(often, 1).err, HasSubstr("damaged"));
}

TEST_F(WatchFaultsTest, DamageAnywhereInTheDatabaseIsFoundOrHarmless) {
  const Arguments often{"--set", "session.checkpoint_every_scans=7"};
  DropScans(Street(15), 0, 15);
  Once(often);
  const std::string sound = Bytes(Path("session/session.db"));
  const std::string trajectory = Bytes(Path("session/trajectory_kitti.txt"));
  for (int i = 0; i < 24; ++i) {
    Write("session/session.db", sound);
    Flip(Path("session/session.db"), (i + 0.37) / 24.0);
    const Outcome outcome = Once(often);
    EXPECT_TRUE(Bytes(Path("session/trajectory_kitti.txt")) == trajectory) << i << outcome.err;
  }
}

TEST_F(WatchFaultsTest, DamagedTilesAreToldAndLeftOut) {
  ASSERT_EQ(Lamina({"synth", "--out", Path("in"), "--sensor", "vlp16", "--frames", "70", "--route",
                    "straight"})
                .code,
            0);
  const Arguments small{"--set", "map.budget_mb=2"};
  Once(small);
  ASSERT_GT(Summary("session")["stored_voxels"], 0);
  // One that is gone is made anew.
  for (const char* end : {"", "-wal", "-shm"})
    fs::remove(Path(std::string("session/map_tiles.db") + end));
  EXPECT_THAT(Once(small).err, HasSubstr("records of the map: what the others held is missing"));
  Write("session/map_tiles.db", std::string(100000, 'x'));
  const Outcome outcome = Once(small);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("map_tiles.db"), HasSubstr("damaged")));
  EXPECT_THAT(Lines(Bytes(Path("session/trajectory_kitti.txt"))), testing::SizeIs(70));
}

}  // namespace
}  // namespace lamina
