// Sessions whose files are damaged, gone, in use, of other options; and localising in one.
#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include "backend/session/checkpoint.h"
#include "backend/session/room.h"
#include "core/base/error.h"
#include "io/file/disk_room.h"
#include "io/map/trajectory_io.h"
#include "tests/support/files/small_disk.h"
#include "tests/support/program/session_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class SessionFaultsTest : public SessionTest {
 protected:
  // A session left after 13 scans, with two checkpoints.
  SessionSetup Left() const {
    SessionSetup setup = Setup("left");
    MapUntil(setup, recording_, 8, Leave::kWhenDone);
    MapUntil(setup, recording_, 13, Leave::kWhenDone);
    EXPECT_THAT(CheckpointsIn(setup.folder).size(), testing::AnyOf(2U, 3U));
    return setup;
  }
  static std::string Checkpoint(const SessionSetup& setup, std::int64_t scans) {
    return setup.folder + "/" + CheckpointName(scans);
  }
  static std::int64_t NextScan(const SessionSetup& setup) { return Session(setup, {}).next_scan(); }

  // What the session comes to if nothing happens to it.
  Result Whole() const { return FinishSession(Setup("whole"), recording_); }

  const Recording recording_ = Record({});
};

TEST_F(SessionFaultsTest, WithTheNewestCheckpointDamagedTheOneBeforeItIsUsed) {
  const Result whole = Whole();
  for (const bool cut : {false, true}) {
    SCOPED_TRACE(cut);
    fs::remove_all(Path("left"));
    const SessionSetup setup = Left();
    const auto there = CheckpointsIn(setup.folder);
    if (cut) {
      fs::resize_file(Checkpoint(setup, there[0]), fs::file_size(Checkpoint(setup, there[0])) / 3);
    } else {
      Damage(Checkpoint(setup, there[0]));
    }
    EXPECT_EQ(NextScan(setup), there[1]);
    ExpectSame(FinishSession(setup, recording_), whole);
    // What is damaged does not count among those kept.
    EXPECT_THAT(CheckpointsIn(setup.folder).size(), testing::AnyOf(2U, 3U));
    EXPECT_EQ(NextScan(setup), 24);
  }
}

TEST_F(SessionFaultsTest, ASessionOfAnotherVersionIsRefusedAndStaysAsItIs) {
  const SessionSetup setup = Left();
  ASSERT_TRUE(fs::exists(setup.folder + "/session.db.backup"));
  SQLite::Database(setup.folder + "/session.db", SQLite::OPEN_READWRITE)
      .exec("UPDATE meta SET value = '1' WHERE key = 'version'");
  EXPECT_THAT(MessageOf<InputError>([&] { Session(setup, {}); }), HasSubstr("is of version 1"));
  EXPECT_TRUE(fs::exists(setup.folder + "/session.db"));
  EXPECT_FALSE(fs::exists(setup.folder + "/session.db.damaged"));
}

TEST_F(SessionFaultsTest, ACheckpointOfAnotherVersionIsRefusedAndAllStaysAsItIs) {
  const SessionSetup setup = Left();
  const auto there = CheckpointsIn(setup.folder);
  std::fstream newest(Checkpoint(setup, there[0]), std::ios::in | std::ios::out | std::ios::binary);
  newest.seekg(8);
  const char version = static_cast<char>(newest.get());
  newest.seekp(8) << "\x63";
  newest.close();
  EXPECT_THAT(MessageOf<OtherFormatError>([&] { Session(setup, {}); }),
              AllOf(HasSubstr("is of version 99"), HasSubstr("version of Lamina that began it")));
  EXPECT_EQ(CheckpointsIn(setup.folder), there);
  newest.open(Checkpoint(setup, there[0]), std::ios::in | std::ios::out | std::ios::binary);
  newest.seekp(8) << version;
  newest.close();
  ExpectSame(FinishSession(setup, recording_), Whole());
}

TEST_F(SessionFaultsTest, WithoutACheckpointAndWithoutFilesItIsRefused) {
  SessionSetup setup = Left();
  setup.has_file = [](const ScanRecord& scan) { return scan.scan >= 5; };
  for (const std::int64_t scans : CheckpointsIn(setup.folder)) Damage(Checkpoint(setup, scans));
  for (int again = 0; again < 2; ++again) {
    EXPECT_THAT(MessageOf<InputError>([&] { Session(setup, {}); }),
                HasSubstr("the files of the first scans are gone"));
  }
}

TEST_F(SessionFaultsTest, LeftWhileScansAreRepeatedTheFilesKeepWhatTheyHad) {
  const SessionSetup setup = Left();
  {
    Session session(setup, {});
    Map(&session, recording_, 24);
    session.Finish();
  }
  const std::string before = Bytes(setup.folder + "/trajectory_kitti.txt");
  const auto newest = CheckpointsIn(setup.folder);
  for (std::size_t i = 0; i + 1 < newest.size(); ++i) fs::remove(Checkpoint(setup, newest[i]));
  {
    Session session(setup, {});
    ASSERT_LE(session.next_scan() + 2, 23);
    Map(&session, recording_, session.next_scan() + 2);
    EXPECT_TRUE(session.Repeating());
    session.Finish();
  }
  EXPECT_TRUE(Bytes(setup.folder + "/trajectory_kitti.txt") == before);
}

TEST_F(SessionFaultsTest, WithAllCheckpointsDamagedItBeginsAtTheStart) {
  const Result whole = Whole();
  const SessionSetup setup = Left();
  for (const std::int64_t scans : CheckpointsIn(setup.folder)) Damage(Checkpoint(setup, scans));
  EXPECT_EQ(NextScan(setup), 0);
  ExpectSame(FinishSession(setup, recording_), whole);
}

TEST_F(SessionFaultsTest, ACheckpointUnderAnotherNameIsNotTakenForWhatItIsNot) {
  const Result whole = Whole();
  const SessionSetup setup = Left();
  const auto there = CheckpointsIn(setup.folder);
  fs::rename(Checkpoint(setup, there[0]), Checkpoint(setup, there[0] + 1));
  EXPECT_EQ(NextScan(setup), there[1]);
  ExpectSame(FinishSession(setup, recording_), whole);
}

TEST_F(SessionFaultsTest, ADamagedDatabaseGivesWayToItsBackup) {
  const Result whole = Whole();
  const auto head = [](const std::string& path) {
    std::fstream(path, std::ios::in | std::ios::out | std::ios::binary) << "overwritten";
  };
  const auto cut = [](const std::string& path) { fs::resize_file(path, 0); };
  const auto half = [](const std::string& path) { fs::resize_file(path, fs::file_size(path) / 2); };
  const auto gone = [](const std::string& path) { fs::remove(path); };
  const std::function<void(const std::string&)> damages[] = {Damage, head, cut, half, gone};
  for (std::size_t i = 0; i < std::size(damages); ++i) {
    SCOPED_TRACE(i);
    fs::remove_all(Path("left"));
    const SessionSetup setup = Left();
    ASSERT_TRUE(fs::exists(setup.folder + "/session.db.backup"));
    damages[i](setup.folder + "/session.db");
    {
      const Session session(setup, {});
      EXPECT_GT(session.database().scans(), 0);
      EXPECT_GE(session.database().scans(), session.next_scan());
    }
    // Scans that the backup does not know are handed out again.
    ExpectSame(FinishSession(setup, recording_), whole);
  }
}

TEST_F(SessionFaultsTest, CheckpointsOfScansThatTheDatabaseLostAreNotUsedLater) {
  const SessionSetup setup = Left();
  const auto there = CheckpointsIn(setup.folder);
  const std::string backup = setup.folder + "/session.db.backup";
  // A backup from before the newest checkpoint: of a session of as many scans as the older one.
  SessionSetup shorter = Setup("shorter");
  MapUntil(shorter, recording_, there[1], Leave::kWhenDone);
  fs::copy_file(Path("shorter/session.db"), backup, fs::copy_options::overwrite_existing);
  Damage(setup.folder + "/session.db");
  EXPECT_EQ(NextScan(setup), there[1]);
  // Other scans take the place of those lost.
  Recording other = recording_;
  other.files.erase(other.files.begin() + there[1]);
  const SessionSetup undisturbed = Setup("undisturbed");
  const Result should = FinishSession(undisturbed, other);
  // As many as the lost checkpoint is of, and none in its place yet.
  MapUntil(setup, other, there[0], Leave::kAtOnce);
  ExpectSame(FinishSession(setup, other), should);
}

TEST_F(SessionFaultsTest, WithoutABackupADamagedDatabaseIsAnError) {
  const SessionSetup setup = Left();
  fs::remove(setup.folder + "/session.db.backup");
  Damage(setup.folder + "/session.db");
  EXPECT_THAT(MessageOf<InputError>([&] { Session(setup, {}); }), HasSubstr("session.db"));
}

TEST_F(SessionFaultsTest, ASessionInUseNamesTheProcess) {
  const SessionSetup setup = Setup("session");
  {
    const Session session(setup, {});
    EXPECT_THAT(
        MessageOf<InputError>([&] { Session(setup, {}); }),
        AllOf(HasSubstr(setup.folder), HasSubstr("in use"), HasSubstr(std::to_string(getpid()))));
    // Nor does the attempt set the first one free.
    EXPECT_THROW(Session(setup, {}), InputError);
  }
  EXPECT_EQ(NextScan(setup), 0);
}

TEST_F(SessionFaultsTest, OtherOptionsAreRefusedAndTheLineIsNamed) {
  const Result whole = Whole();
  SessionSetup setup = Left();
  const std::string options[] = {"first: 1\nsecond: 3\n", "first: 1\nsecond: 2\nthird: 3\n",
                                 "first: 1\n", "", "first: 1\nsecond: 2"};
  const std::string lines[] = {"'second: 2', now given 'second: 3'", "'', now given 'third: 3'",
                               "'second: 2', now given ''", "'first: 1', now given ''", ""};
  for (std::size_t i = 0; i < 5; ++i) {
    setup.fixed_options = options[i];
    EXPECT_THAT(MessageOf<OptionError>([&] { Session(setup, {}); }),
                AllOf(HasSubstr(setup.folder), HasSubstr(lines[i])));
  }
  setup = Setup("left");
  setup.session.checkpoint_every_scans = 3;  // decides no results
  ExpectSame(FinishSession(setup, recording_), whole);
}

TEST_F(SessionFaultsTest, OptionsOutOfRangeAreRefused) {
  SessionSetup setup = Setup("session");
  setup.session.checkpoint_every_scans = 0;
  EXPECT_THROW(Session(setup, {}), OptionError);
}

TEST_F(SessionFaultsTest, AFolderThatCannotBeMadeIsNamed) {
  Write("file", "");
  const SessionSetup setup = Setup("file/session");
  EXPECT_THAT(MessageOf<OutputError>([&] { Session(setup, {}); }), HasSubstr(setup.folder));
}

// Of the scans since the last checkpoint some files are gone: in the middle, and the last ones.
TEST_F(SessionFaultsTest, AFileThatIsGoneWhileRepeatingKeepsItsPose) {
  const SessionSetup setup = Left();
  const std::int64_t newest = CheckpointsIn(setup.folder).front();
  std::map<std::int64_t, ScanRecord> gone;
  {
    const SessionDatabase database(setup.folder + "/session.db", true);
    database.ForEach(newest, 13, [&](const ScanRecord& row) {
      if (row.scan == newest || row.scan == 12) gone[row.scan] = row;
    });
  }
  ASSERT_EQ(gone.size(), 2U);
  for (const auto& [scan, row] : gone) {
    fs::remove(recording_.files[static_cast<std::size_t>(scan)].path);
  }
  const auto check = [&](const Session& session) {
    int seen = 0;
    session.ForEachPose([&](const FinalPose& pose) {
      const auto found = gone.find(static_cast<std::int64_t>(pose.scan));
      if (found == gone.end()) return;
      ++seen;
      EXPECT_FALSE(pose.skipped) << "scan " << pose.scan;
      EXPECT_EQ(pose.pose.T_world_lidar.t, found->second.T_world_lidar.t) << "scan " << pose.scan;
    });
    EXPECT_EQ(seen, 2);
  };
  {
    // While its pose is open still: at the end ...
    Session session(setup, {});
    Map(&session, recording_, 13);
    session.Finish();
    check(session);
    EXPECT_EQ(ReadTrajectory(setup.folder + "/trajectory_tum.txt").size(), 13U);
  }
  {
    // ... and in a later run, when it becomes final.
    Session session(setup, {});
    Map(&session, recording_, 24);
    session.Finish();
    check(session);
  }
}

TEST_F(SessionFaultsTest, LocalisingFindsScansAndLeavesTheMapAsItIs) {
  Whole();
  Scene scene;
  scene.seed = 2;  // the same way, other points
  Recording visit = Record(scene, "visit");
  const int first = 6;
  visit.files.erase(visit.files.begin(), visit.files.begin() + first);
  visit.truth.erase(visit.truth.begin(), visit.truth.begin() + first);
  const auto before = FilesOf("whole");
  SessionSetup setup = Setup("visited");
  // Where it starts is known roughly.
  const SE3 start = recording_.truth[0].Inverse() * visit.truth[0];
  setup.base_map = BaseMap{Path("whole"), setup.fixed_options, start * Draws(3).Offset(0.02, 0.1)};
  const std::string map = BytesOf(Session(setup, {}).mapping().map());
  EXPECT_GT(map.size(), 10000U);
  MapUntil(setup, visit, 7, Leave::kAtOnce);
  MapUntil(setup, visit, 12, Leave::kWhenDone);  // continues as any other session
  std::vector<FinalPose> poses;
  {
    Session session(setup, {});
    EXPECT_GT(session.next_scan(), 0);
    Map(&session, visit, static_cast<std::int64_t>(visit.files.size()));
    EXPECT_EQ(session.mapping().counts().lost, 0U);
    session.Finish();
    session.ForEachPose([&](const FinalPose& pose) { poses.push_back(pose); });
    EXPECT_TRUE(BytesOf(session.mapping().map()) == map);
  }
  ASSERT_EQ(poses.size(), visit.truth.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const SE3 truth = recording_.truth[0].Inverse() * visit.truth[i];
    EXPECT_LT((poses[i].pose.T_world_lidar.t - truth.t).norm(), 0.05) << "scan " << i;
  }
  const auto after = FilesOf("whole");
  ASSERT_EQ(after.size(), before.size());
  for (const auto& [name, bytes] : before) EXPECT_TRUE(after.at(name) == bytes) << name;
  // The same in one go.
  setup.folder = Path("visited_at_once");
  const Result at_once = FinishSession(setup, visit);
  EXPECT_EQ(at_once.kitti, Bytes(Path("visited/trajectory_kitti.txt")));
}

TEST_F(SessionFaultsTest, AMapIsNotLocalisedInWhileItIsMadeNorChangedWhileItIsCopied) {
  const SessionSetup base = Left();
  SessionSetup visit = Setup("visited");
  visit.base_map = BaseMap{base.folder, base.fixed_options, SE3()};
  {
    const Session writer(base, {});
    EXPECT_THAT(
        MessageOf<InputError>([&] { Session(visit, {}); }),
        AllOf(HasSubstr(base.folder), HasSubstr("in use by process " + std::to_string(getpid()))));
  }
  // As one that localises in it holds it.
  const int reader = open((base.folder + "/lock").c_str(), O_RDONLY);
  ASSERT_EQ(flock(reader, LOCK_SH | LOCK_NB), 0);
  EXPECT_THAT(MessageOf<InputError>([&] { Session(base, {}); }),
              AllOf(HasSubstr(base.folder), HasSubstr("is copying the map of this one")));
  // Any number may copy it.
  { const Session session(visit, {}); }
  close(reader);
  EXPECT_GT(NextScan(base), 0);
}

TEST_F(SessionFaultsTest, WithoutABackupOldCheckpointsGoAllTheSame) {
  const SessionSetup setup = Setup("session");
  const std::string backup = setup.folder + "/session.db.backup";
  MapUntil(setup, recording_, 8, Leave::kWhenDone);
  const std::string before = Bytes(backup);
  ASSERT_NE(before, "");
  const std::int64_t backed_up = SessionBackup::Scans(backup);
  // From now on none can be written.
  fs::create_directories(backup + ".partial/in_the_way");
  for (const std::int64_t end : {16, 24}) MapUntil(setup, recording_, end, Leave::kWhenDone);
  EXPECT_TRUE(Bytes(backup) == before);
  const auto there = CheckpointsIn(setup.folder);
  EXPECT_GT(there.front(), backed_up);
  EXPECT_THAT(there.size(), testing::AllOf(testing::Ge(2U), testing::Le(3U)));
  // What the old backup leads to is still there.
  EXPECT_LE(there.back(), backed_up);
  fs::resize_file(setup.folder + "/session.db", 0);
  EXPECT_EQ(NextScan(setup), there.back());
}

TEST_F(SessionFaultsTest, FilesThatWereCutShortAreGoneAtTheNextStart) {
  const SessionSetup setup = Left();
  const char* const kCut[] = {"checkpoint-20.lmap.partial", "session.db.backup.partial",
                              "session.db.backup.partial-journal", "trajectory_tum.txt.partial"};
  for (const char* name : kCut) Write(std::string("left/") + name, "half");
  EXPECT_GT(NextScan(setup), 0);
  for (const char* name : kCut) EXPECT_FALSE(fs::exists(setup.folder + "/" + name)) << name;
}

TEST_F(SessionFaultsTest, AFullDiskIsAnErrorThatSaysSoAndNothingIsLost) {
  const Result whole = Whole();
  const SmallDisk disk(Path("session"), 64 << 20);
  if (!disk.mounted()) GTEST_SKIP() << "only root can mount";
  const SessionSetup setup = Setup("session");
  MapUntil(setup, recording_, 8, Leave::kWhenDone);
  EXPECT_GT(RoomToContinue(setup.folder), kWorkingRoomBytes + 10000);
  disk.Fill();
  EXPECT_THROW(FinishSession(setup, recording_), DiskFullError);
  disk.Empty();
  ExpectSame(FinishSession(setup, recording_), whole);
}

TEST_F(SessionFaultsTest, LocalisingNeedsAMap) {
  SessionSetup setup = Setup("visited");
  setup.base_map = BaseMap{Path("none"), setup.fixed_options, SE3()};
  EXPECT_THAT(MessageOf<InputError>([&] { Session(setup, {}); }), HasSubstr(Path("none")));
}

}  // namespace
}  // namespace lamina
