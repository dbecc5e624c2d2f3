// Databases that are damaged, foreign, copied while they are written, or out of room.
#include <SQLiteCpp/SQLiteCpp.h>

#include <algorithm>
#include <atomic>
#include <thread>

#include "io/file/disk_room.h"
#include "tests/io/store/session_database_fixture.h"
#include "tests/support/files/small_disk.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

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
        EXPECT_EQ(BytesOf(row), BytesOf(FullRow(row.scan, std::to_string(row.scan))));
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
      for (int i = 0; i < kBatch; ++i, ++scan) database.Put(ScanRow(scan, std::to_string(scan)));
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
      database.Put(FullRow(scan, std::to_string(scan)));
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
      ScanRecord scan = ScanRow(next_, std::to_string(next_));
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
