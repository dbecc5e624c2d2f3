#include "io/store/session_database.h"

#include <SQLiteCpp/SQLiteCpp.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <thread>

#include "core/geometry/state_archive.h"
#include "io/file/disk_room.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/files/small_disk.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

// All fields as bytes, so that NaN equals NaN.
std::string BytesOf(ScanRecord s) {
  StateArchive a;
  bool has_next = s.next_stamp_ns.has_value();
  StampNs next = s.next_stamp_ns.value_or(0);
  a(&s.scan, &s.file, &s.sequence, &s.stamp_ns, &s.recorded_stamp, &has_next, &next, &s.skipped,
    &s.final, &s.T_world_lidar, &s.status, &s.detail, &s.keyframe, &s.searched, &s.points,
    &s.clusters, &s.matched, &s.iterations, &s.unobservable_directions, &s.inlier_share,
    &s.residual_m, &s.worst_sigma_m, &s.covariance, &s.read_ms, &s.prepare_ms, &s.cluster_ms,
    &s.odometry_ms, &s.map_ms, &s.solve_ms);
  return a.written();
}

ScanRecord Scan(std::int64_t number, const std::string& file, const std::string& sequence = "") {
  Draws draws(static_cast<unsigned>(number));
  ScanRecord s;
  s.scan = number;
  s.file = file;
  s.sequence = sequence;
  s.stamp_ns = 1000 * number;
  s.T_world_lidar = draws.Pose(100.0);
  s.status = "tracked";
  return s;
}

// No field as it is by default.
ScanRecord Full(std::int64_t number, const std::string& file) {
  ScanRecord s = Scan(number, file, "drives/one");
  s.recorded_stamp = s.skipped = s.final = s.keyframe = s.searched = true;
  s.next_stamp_ns = -1;
  s.detail = "why: \"\xe2\x80\xa6\"\n\xff";
  s.points = 1;
  s.clusters = 2;
  s.matched = 3;
  s.iterations = 4;
  s.unobservable_directions = 5;
  s.inlier_share = 0.1;
  s.residual_m = 0.2;
  s.worst_sigma_m = 0.3;
  for (int i = 0; i < 36; ++i) s.covariance(i) = 0.1 * i;
  s.read_ms = 1.5;
  s.prepare_ms = 2.5;
  s.cluster_ms = 3.5;
  s.odometry_ms = 4.5;
  s.map_ms = 5.5;
  s.solve_ms = 6.5;
  return s;
}

class SessionDatabaseTest : public FilesTest {
 protected:
  std::string File() const { return Path("session.db"); }
  std::unique_ptr<SessionDatabase> Open() const {
    return std::make_unique<SessionDatabase>(File(), true);
  }
  static std::vector<ScanRecord> All(const SessionDatabase& database) {
    std::vector<ScanRecord> rows;
    database.ForEach(0, std::numeric_limits<std::int64_t>::max(),
                     [&](const ScanRecord& row) { rows.push_back(row); });
    return rows;
  }
  void Execute(const std::string& statement) const {
    SQLite::Database(File(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE).exec(statement);
  }
  std::string ErrorOnOpening() const {
    const std::string message = MessageOf<InputError>([this] { Open(); });
    EXPECT_THAT(message, HasSubstr(File()));
    return message;
  }
  // A database of some pages, closed.
  void Fill(int rows) const {
    const auto database = Open();
    database->Begin();
    for (int i = 0; i < rows; ++i) database->Put(Full(i, std::to_string(i)));
    database->Commit();
  }
};

TEST_F(SessionDatabaseTest, EveryFieldComesBackToTheLastBit) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  std::vector<ScanRecord> rows = {Full(0, "a.bin"), Scan(1, "b.bin")};
  rows.push_back(Full(2, "c.bin"));
  rows[2].inlier_share = std::numeric_limits<double>::quiet_NaN();
  rows[2].residual_m = kInf;
  rows[2].worst_sigma_m = -kInf;
  rows[2].covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  rows[2].T_world_lidar.t = {kInf, std::nan(""), 1e-310};
  rows[2].T_world_lidar.q.coeffs() *= 1.0 + 1e-13;  // must not be normalised on the way
  rows[2].stamp_ns = std::numeric_limits<StampNs>::min();
  rows[2].next_stamp_ns = std::numeric_limits<StampNs>::max();
  rows[2].points = std::numeric_limits<std::int64_t>::max();
  {
    const auto database = Open();
    for (const ScanRecord& row : rows) database->Put(row);
  }
  const std::vector<ScanRecord> read = All(*Open());
  ASSERT_EQ(read.size(), rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_EQ(BytesOf(read[i]), BytesOf(rows[i])) << "row " << i;
  }
}

TEST_F(SessionDatabaseTest, NamesAreBytes) {
  const std::vector<std::string> names = {
      "plain.bin", "with space.bin", "new\nline.bin",        "quote'\".bin", "\xff\xfe invalid.bin",
      "\xc3\xa4",  "%s ? :a $b.bin", std::string(4096, 'x'), "PLAIN.bin",    "plain.bin "};
  const auto database = Open();
  for (std::size_t i = 0; i < names.size(); ++i) {
    EXPECT_FALSE(database->Knows(names[i]));
    database->Put(Scan(static_cast<std::int64_t>(i), names[i], names[i]));
    EXPECT_TRUE(database->Knows(names[i]));
  }
  const std::vector<ScanRecord> rows = All(*Open());
  ASSERT_EQ(rows.size(), names.size());
  for (std::size_t i = 0; i < names.size(); ++i) {
    EXPECT_EQ(rows[i].file, names[i]);
    EXPECT_EQ(rows[i].sequence, names[i]);
  }
  EXPECT_EQ(database->Sequences(100).size(), names.size());
}

TEST_F(SessionDatabaseTest, KnowsScansAndFilesSetAside) {
  const auto database = Open();
  EXPECT_FALSE(database->Knows(""));
  database->Put(Scan(0, "scan.bin"));
  database->SetAside("late\n\xff.bin", "it came late");
  database->SetAside("late\n\xff.bin", "again");
  EXPECT_TRUE(database->Knows("scan.bin"));
  EXPECT_TRUE(database->Knows("late\n\xff.bin"));
  EXPECT_FALSE(database->Knows("late"));
  EXPECT_FALSE(database->Knows("scan.bi"));
  EXPECT_EQ(database->scans(), 1);
  EXPECT_EQ(database->set_aside(), 1);
}

TEST_F(SessionDatabaseTest, AScanTakesThePlaceOfWhatWasKnownOfIt) {
  const auto database = Open();
  database->Put(Scan(0, "a"));
  database->Put(Full(0, "a"));
  ASSERT_EQ(All(*database).size(), 1U);
  EXPECT_EQ(BytesOf(All(*database)[0]), BytesOf(Full(0, "a")));
}

TEST_F(SessionDatabaseTest, ScansAreShownInOrderFromAndTo) {
  const auto database = Open();
  EXPECT_EQ(database->scans(), 0);
  for (const int i : {3, 0, 2, 1, 4}) database->Put(Scan(i, std::to_string(i)));
  EXPECT_EQ(database->scans(), 5);
  std::vector<std::int64_t> seen;
  database->ForEach(1, 4, [&](const ScanRecord& row) { seen.push_back(row.scan); });
  EXPECT_EQ(seen, (std::vector<std::int64_t>{1, 2, 3}));
  database->ForEach(5, 9, [&](const ScanRecord&) { ADD_FAILURE(); });
}

TEST_F(SessionDatabaseTest, AFinalPoseIsPutIntoItsRow) {
  const SE3 T = Draws(9).Pose(1.0);
  {
    const auto database = Open();
    for (int i = 0; i < 2; ++i) database->Put(Scan(i, std::to_string(i)));
    database->Finalise({1, T, false});
  }
  ScanRecord expected = Scan(1, "1");
  expected.T_world_lidar = T;
  expected.final = true;
  const std::vector<ScanRecord> rows = All(*Open());
  EXPECT_EQ(BytesOf(rows[0]), BytesOf(Scan(0, "0")));
  EXPECT_EQ(BytesOf(rows[1]), BytesOf(expected));
  EXPECT_THROW(Open()->Finalise({7, T, false}), std::logic_error);
}

TEST_F(SessionDatabaseTest, APoseBetweenNeighboursDoesNotReplaceOneOfAScansOwn) {
  const auto database = Open();
  ScanRecord skipped = Scan(0, "0"), own = Scan(1, "1");
  skipped.skipped = true;
  database->Put(skipped);
  database->Put(own);
  const SE3 T = Draws(9).Pose(1.0);
  database->Finalise({0, T, true});
  database->Finalise({1, T, true});
  const std::vector<ScanRecord> rows = All(*database);
  EXPECT_EQ(rows[0].T_world_lidar.t, T.t);
  EXPECT_TRUE(rows[0].final);
  EXPECT_EQ(BytesOf(rows[1]), BytesOf(own));
}

TEST_F(SessionDatabaseTest, TheLastScansOfASequenceComeInOrder) {
  const auto database = Open();
  const std::string sequences[] = {"b", "a", "b", "", "b", "b"};
  for (int i = 0; i < 6; ++i) database->Put(Scan(i, std::to_string(i), sequences[i]));
  const auto told = [&](std::int64_t to, int most) {
    std::string text;
    for (const ScanRecord& row : database->LastOf("b", to, most)) text += row.file;
    return text;
  };
  EXPECT_EQ(told(6, 2), "45");
  EXPECT_EQ(told(5, 9), "024");
  EXPECT_EQ(told(0, 9), "");
}

TEST_F(SessionDatabaseTest, SequencesTellTheirLastScanAndTheirNumber) {
  const auto database = Open();
  EXPECT_TRUE(database->Sequences(10).empty());
  const std::string sequences[] = {"b", "a", "b", "", "a", "b"};
  for (int i = 0; i < 6; ++i) database->Put(Scan(i, std::to_string(i), sequences[i]));
  const auto told = [&](std::int64_t to) {
    std::string text;
    for (const SessionDatabase::Sequence& s : database->Sequences(to)) {
      text += s.last.sequence + ":" + s.last.file + "/" + std::to_string(s.scans) + " ";
    }
    return text;
  };
  EXPECT_EQ(told(0), "");
  EXPECT_EQ(told(3), "a:1/1 b:2/2 ");
  EXPECT_EQ(told(100), ":3/1 a:4/2 b:5/3 ");
}

TEST_F(SessionDatabaseTest, SolvesFromAScanOnAreForgotten) {
  {
    const auto database = Open();
    for (int i = 0; i < 10; ++i) {
      SessionSolve solve;
      solve.before_scan = i;
      solve.initial_cost = std::nan("");
      solve.usable = i % 2 == 0;
      database->Put(solve);
    }
    database->DropSolvesFrom(7);
  }
  SQLite::Database database(File());
  EXPECT_EQ(database.execAndGet("SELECT COUNT(*) FROM solves").getInt(), 7);
  EXPECT_EQ(database.execAndGet("SELECT MAX(before_scan) FROM solves").getInt(), 6);
  EXPECT_EQ(database.execAndGet("SELECT SUM(usable) FROM solves").getInt(), 4);
}

TEST_F(SessionDatabaseTest, WhatIsNotCommittedIsUndone) {
  {
    const auto database = Open();
    database->Put(Scan(0, "before"));
    database->Begin();
    database->Put(Scan(1, "committed"));
    database->Commit();
    database->Begin();
    database->Put(Scan(2, "undone"));
    database->SetAside("undone", "");
    database->Finalise({0, SE3(), false});
    EXPECT_TRUE(database->Knows("undone"));
    // No other connection sees it.
    EXPECT_EQ(SessionDatabase(File(), false).scans(), 2);
  }
  const auto database = Open();
  EXPECT_EQ(database->scans(), 2);
  EXPECT_FALSE(database->Knows("undone"));
  EXPECT_EQ(BytesOf(All(*database)[0]), BytesOf(Scan(0, "before")));
}

TEST_F(SessionDatabaseTest, MetaIsKept) {
  EXPECT_EQ(Open()->Meta("key"), std::nullopt);
  Open()->SetMeta("key", "one\ntwo");
  Open()->SetMeta("empty", "");
  EXPECT_EQ(Open()->Meta("key"), "one\ntwo");
  EXPECT_EQ(Open()->Meta("empty"), "");
  Open()->SetMeta("key", "three");
  EXPECT_EQ(Open()->Meta("key"), "three");
  const auto execute = [this](const char* statement) {
    SQLite::Database(Path("session.db"), SQLite::OPEN_READWRITE).exec(statement);
  };
  execute("UPDATE meta SET value = 'thrEe' WHERE key = 'key'");
  EXPECT_THAT(MessageOf<InputError>([this] { Open()->Meta("key"); }),
              HasSubstr("is damaged: the checksum of 'key' differs"));
  // Of an older program.
  execute("DELETE FROM meta WHERE key = 'key.crc32'");
  EXPECT_EQ(Open()->Meta("key"), "thrEe");
}

TEST_F(SessionDatabaseTest, ADamagedRowIsNamed) {
  const std::string changes[] = {
      "pose = CAST(X'00' || substr(pose, 2) AS BLOB)",  // the first byte of a quaternion
      "pose = substr(pose, 1, 55)",
      "stamp_ns = stamp_ns + 1",
      "crc = crc + 1",
      "file = CAST('other' AS BLOB)",
      "covariance = substr(covariance, 1, 287)",
      "covariance = X''",
      "pose = CAST(pose || X'00' AS BLOB)",
      "sequence = CAST('x' AS BLOB)",
      "skipped = 0",
      "recorded_stamp = 0",
      "next_stamp_ns = NULL",
      "points = 7",
      "solve_ms = NULL",
      "detail = 'because'"};
  for (const std::string& change : changes) {
    SCOPED_TRACE(change);
    fs::remove(File());
    Fill(10);
    Execute("UPDATE scans SET " + change + " WHERE scan = 7");
    EXPECT_THAT(ErrorOnOpening(), HasSubstr("scan 7"));
    // Unasked, it is found when it is read.
    const SessionDatabase unchecked(File(), false);
    EXPECT_THROW(All(unchecked), InputError);
  }
}

TEST_F(SessionDatabaseTest, ForeignFilesAreRefusedAndLeftAsTheyAre) {
  const std::string text = Write("session.db", std::string(5000, 'x'));
  EXPECT_THAT(ErrorOnOpening(), HasSubstr("not a database"));
  EXPECT_EQ(Bytes(text), std::string(5000, 'x'));
  fs::remove(File());
  Execute("CREATE TABLE songs(name)");
  const std::string before = Bytes(File());
  EXPECT_THAT(ErrorOnOpening(), HasSubstr("songs"));
  EXPECT_EQ(Bytes(File()), before);
  fs::remove(File());
  Execute("CREATE TABLE scans(name)");
  ErrorOnOpening();
  EXPECT_THROW(SessionDatabase(folder_.string(), true), OutputError);
  EXPECT_THROW(SessionDatabase(Path("none/session.db"), true), OutputError);
}

TEST_F(SessionDatabaseTest, OtherVersionsAreNamed) {
  {
    // The tables of another version may be other ones, too.
    SQLite::Database other(File(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    other.exec("CREATE TABLE meta(key TEXT PRIMARY KEY, value TEXT NOT NULL)");
    other.exec("INSERT INTO meta VALUES('version', '1')");
    other.exec("CREATE TABLE scans(scan INTEGER PRIMARY KEY)");
  }
  const std::string before = Bytes(File());
  EXPECT_THAT(ErrorOnOpening(), AllOf(HasSubstr("version 1"), HasSubstr("version 2")));
  EXPECT_THROW(Open(), OtherFormatError);
  EXPECT_TRUE(Bytes(File()) == before);
}

TEST_F(SessionDatabaseTest, AFileCutShortIsDamaged) {
  Fill(100);
  const std::string whole = Bytes(File());
  ASSERT_GT(whole.size(), 30000U);
  for (const double share : {0.001, 0.3, 0.5, 0.9, 0.999}) {
    SCOPED_TRACE(share);
    const auto size = static_cast<std::size_t>(share * static_cast<double>(whole.size()));
    Write("session.db", whole.substr(0, size));
    ErrorOnOpening();
  }
}

// Wherever a page is overwritten: either nothing of what is asked for has changed, or it is told.
TEST_F(SessionDatabaseTest, AnOverwrittenPageIsDamageOrHasNoEffect) {
  Fill(60);
  const std::string whole = Bytes(File());
  std::size_t told = 0, pages = 0;
  for (std::size_t at = 0; at + 4096 <= whole.size(); at += 4096, ++pages) {
    std::string bad = whole;
    bad.replace(at + 200, 3000, std::string(3000, '\x5a'));
    Write("session.db", bad);
    fs::remove(File() + "-wal");
    fs::remove(File() + "-shm");
    try {
      const auto database = Open();
      const std::vector<ScanRecord> rows = All(*database);
      ASSERT_EQ(rows.size(), 60U) << "page " << pages;
      for (const ScanRecord& row : rows) {
        EXPECT_TRUE(database->Knows(row.file));
        EXPECT_EQ(BytesOf(row), BytesOf(Full(row.scan, std::to_string(row.scan))));
      }
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(File()));
      ++told;
    }
  }
  EXPECT_GT(told, pages / 2);
}

TEST_F(SessionDatabaseTest, ABackupIsWholeWhileAnotherConnectionWrites) {
  constexpr int kBatch = 5;
  const auto reader = Open();
  std::atomic<bool> stop{false};
  std::thread writer([&] {
    SessionDatabase database(File(), false);
    for (int scan = 0; !stop;) {
      database.Begin();
      for (int i = 0; i < kBatch; ++i, ++scan) database.Put(Scan(scan, std::to_string(scan)));
      database.Commit();
    }
  });
  std::int64_t least = 0;
  for (int i = 0; i < 20; ++i) {
    const std::int64_t before = reader->scans();
    reader->BackUpTo(Path("backup.db"));
    EXPECT_FALSE(fs::exists(Path("backup.db.partial")));
    const std::string bytes = Bytes(Path("backup.db"));
    Write("copy/session.db", bytes);  // alone: no log beside it
    const SessionDatabase copy(Path("copy/session.db"), true);
    EXPECT_GE(copy.scans(), before);
    EXPECT_EQ(copy.scans() % kBatch, 0) << "a transaction is there as a whole";
    EXPECT_EQ(static_cast<std::int64_t>(All(copy).size()), copy.scans());
    least = std::max(least, copy.scans());
    if (i % 5 == 0) reader->Tidy();
  }
  stop = true;
  writer.join();
  EXPECT_GE(reader->scans(), least);
}

TEST_F(SessionDatabaseTest, ABackupThatCannotBeWrittenLeavesTheOlderOne) {
  Fill(3);
  const auto database = Open();
  database->BackUpTo(Path("backup.db"));
  const std::string before = Bytes(Path("backup.db"));
  fs::create_directories(Path("backup.db.partial/in_the_way"));
  EXPECT_THROW(database->BackUpTo(Path("backup.db")), OutputError);
  EXPECT_EQ(Bytes(Path("backup.db")), before);
  EXPECT_THROW(database->BackUpTo(Path("none/backup.db")), OutputError);
}

TEST_F(SessionDatabaseTest, ABackupForWhichThereIsNoRoomLeavesNothingOfItself) {
  Fill(2000);
  const auto database = Open();
  database->Tidy();
  const std::uint64_t size = fs::file_size(File());
  const SmallDisk disk(Path("disk"), size + size / 2);
  if (!disk.mounted()) GTEST_SKIP() << "only root can mount";
  database->BackUpTo(Path("disk/backup.db"));
  const std::string before = Bytes(Path("disk/backup.db"));
  const std::uint64_t free = FreeBytes(Path("disk"));
  // Half of a second copy fits: it is not even begun, and the error says what it takes.
  const std::string message =
      MessageOf<DiskFullError>([&] { database->BackUpTo(Path("disk/backup.db")); });
  EXPECT_THAT(message, AllOf(HasSubstr(std::to_string(size) + " bytes are needed"),
                             HasSubstr(std::to_string(free) + " are free")));
  EXPECT_EQ(Bytes(Path("disk/backup.db")), before);
  EXPECT_EQ(FreeBytes(Path("disk")), free);
  EXPECT_FALSE(fs::exists(Path("disk/backup.db.partial")));
  // Room for the copy, but not for what is to be left.
  fs::remove(Path("disk/backup.db"));
  EXPECT_THROW(database->BackUpTo(Path("disk/backup.db"), size), DiskFullError);
  database->BackUpTo(Path("disk/backup.db"), 1000);
}

TEST_F(SessionDatabaseTest, AFullDiskIsAnErrorOfItsOwn) {
  const SmallDisk disk(Path("disk"), 1 << 20);
  if (!disk.mounted()) GTEST_SKIP() << "only root can mount";
  SessionDatabase database(Path("disk/session.db"), true);
  const auto fill = [&] {
    for (int scan = 0; scan < 2000; ++scan) {
      database.Begin();
      database.Put(Full(scan, std::to_string(scan)));
      database.Commit();
    }
  };
  EXPECT_THAT(MessageOf<DiskFullError>(fill), HasSubstr(Path("disk/session.db")));
}

// Writes scans with details of that size, each on its own, as the log of a session does.
class EndlessWriter {
 public:
  explicit EndlessWriter(SessionDatabase* database) : database_(database) {}

  void Write(int scans, std::size_t detail_bytes) {
    for (int i = 0; i < scans; ++i, ++next_) {
      ScanRecord scan = Scan(next_, std::to_string(next_));
      scan.detail = std::string(detail_bytes, 'd');
      database_->Begin();
      database_->Put(scan);
      database_->Commit();
      database_->LimitLog();
    }
  }

 private:
  SessionDatabase* database_;
  std::int64_t next_ = 0;
};

TEST_F(SessionDatabaseTest, TheLogStaysShortWhileScansComeWithoutAPause) {
  constexpr std::uintmax_t kMostBytes = 12 << 20;
  const auto database = Open(), other = Open();
  EndlessWriter writer(database.get());
  std::uintmax_t longest = 0;
  for (int i = 1; i <= 20; ++i) {
    writer.Write(10, 200000);
    EXPECT_EQ(other->scans(), 10 * i);
    longest = std::max(longest, fs::file_size(File() + "-wal"));
  }
  EXPECT_GT(longest, kMostBytes / 4) << "too few scans to tell";
  EXPECT_LT(longest, kMostBytes);
  EXPECT_EQ(All(*other).size(), 200U);
}

// Who copies the whole, say, takes his time: the writer does not wait, and the log begins anew
// when he is done.
TEST_F(SessionDatabaseTest, TheLogBeginsAnewAfterALongReaderForWhomNobodyWaits) {
  const auto database = Open(), reader = Open();
  EndlessWriter writer(database.get());
  writer.Write(1, 100);
  reader->ForEach(0, 1, [&](const ScanRecord&) { writer.Write(100, 300000); });
  const std::uintmax_t under_reader = fs::file_size(File() + "-wal");
  EXPECT_GT(under_reader, 30000000U);
  writer.Write(100, 300000);
  EXPECT_LT(fs::file_size(File() + "-wal"), under_reader + 12000000);
  EXPECT_EQ(All(*reader).size(), 201U);
}

}  // namespace
}  // namespace lamina
