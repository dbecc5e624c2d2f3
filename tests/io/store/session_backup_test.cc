#include "io/store/session_backup.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

#include "io/store/session_database.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// A session at work: scans, of which the last ones are open, solves and files set aside.
class SessionAtWork {
 public:
  explicit SessionAtWork(SessionDatabase* database) : database_(database) {}

  void Go(int scans) {
    database_->Begin();
    for (int i = 0; i < scans; ++i, ++next_) {
      ScanRecord scan;
      scan.scan = next_;
      scan.file = std::to_string(next_);
      database_->Put(scan);
      SE3 T;
      T.t.x() = static_cast<double>(next_);
      if (next_ >= 9) database_->Finalise({next_ - 9, T, false});
      if (next_ % 3 == 0) {
        SessionSolve solve;
        solve.before_scan = next_;
        database_->Put(solve);
      }
      if (next_ % 40 == 0) database_->SetAside("late " + std::to_string(next_), "late");
    }
    database_->SetMeta("done", std::to_string(next_));
    database_->Commit();
  }

 private:
  SessionDatabase* database_;
  std::int64_t next_ = 0;
};

// Every row of every table.
std::string AllRows(const std::string& path) {
  std::string rows;
  SQLite::Database database(path, SQLite::OPEN_READWRITE);
  for (const char* table : {"meta", "scans", "solves", "set_aside"}) {
    SQLite::Statement all(database, std::string("SELECT * FROM ") + table + " ORDER BY 1");
    while (all.executeStep()) {
      for (int i = 0; i < all.getColumnCount(); ++i) rows += all.getColumn(i).getString() + "|";
      rows += "\n";
    }
  }
  return rows;
}

class SessionBackupTest : public FilesTest {
 protected:
  std::string File() const { return Path("session.db"); }
  std::string Copy() const { return Path("backup"); }
  // In a process of its own.
  [[noreturn]] void KeepBackingUp() const {
    SessionDatabase database(File(), false);
    SessionAtWork session(&database);
    SessionBackup backup(File(), Copy());
    session.Go(300);
    while (true) {
      backup.Update();
      session.Go(100);
    }
  }
  // Makes a new session, and ends it some time after its first copy.
  void BackUpUntilKilled(Draws* draws) const {
    for (const auto& entry : fs::directory_iterator(folder_)) fs::remove(entry.path());
    const pid_t child = fork();
    if (child == 0) KeepBackingUp();
    while (!fs::exists(Copy())) usleep(1000);
    usleep(static_cast<useconds_t>(draws->Integer(1000, 80000)));
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
  }
};

TEST_F(SessionBackupTest, IsBroughtUpToDateAgainAndAgain) {
  SessionDatabase database(File(), false);
  SessionAtWork session(&database);
  SessionBackup backup(File(), Copy());
  std::int64_t scans = 0;
  for (const int more : {5, 0, 1, 3, 100, 7, 1, 30}) {
    session.Go(more);
    scans += more;
    EXPECT_EQ(backup.Update(), scans);
    ASSERT_EQ(AllRows(Copy()), AllRows(File())) << more;
  }
  EXPECT_FALSE(fs::exists(Path("backup-journal")));
  EXPECT_FALSE(fs::exists(Path("backup-wal")));
  // It can take the place of the other.
  EXPECT_EQ(SessionDatabase(Copy(), true).scans(), scans);
}

TEST_F(SessionBackupTest, CostsWhatHasCome) {
  SessionDatabase database(File(), false);
  SessionAtWork session(&database);
  SessionBackup backup(File(), Copy());
  session.Go(4000);
  backup.Update();
  session.Go(20);
  const std::uint64_t before = BytesWritten();
  backup.Update();
  EXPECT_LT(BytesWritten() - before, fs::file_size(Copy()) / 10);
  EXPECT_EQ(AllRows(Copy()), AllRows(File()));
}

TEST_F(SessionBackupTest, OneThatIsTakenAwayOrDamagedIsMadeAgain) {
  SessionDatabase database(File(), false);
  SessionAtWork session(&database);
  SessionBackup backup(File(), Copy());
  for (const bool damaged : {false, true}) {
    session.Go(50);
    backup.Update();
    fs::remove(Copy());
    if (damaged) Write("backup", std::string(10000, 'x'));
    EXPECT_THAT(MessageOf<OutputError>([&] { backup.Update(); }), testing::HasSubstr(Copy()));
    backup.Update();
    EXPECT_EQ(AllRows(Copy()), AllRows(File()));
  }
}

// Whenever the process is killed, the copy is that of a moment, after what it had begun is undone.
TEST_F(SessionBackupTest, IsWholeWheneverTheProcessIsKilled) {
  Draws draws(9);
  for (int round = 0; round < 12; ++round) {
    BackUpUntilKilled(&draws);
    SessionBackup::RollBack(Copy());
    ASSERT_FALSE(fs::exists(Path("backup-journal")));
    fs::copy_file(Copy(), Path("copy"));
    const SessionDatabase copy(Path("copy"), true);
    EXPECT_EQ(copy.scans() % 100, 0);
    EXPECT_EQ(copy.Meta("done"), std::to_string(copy.scans()));
  }
}

// What a process that was killed had begun does not get into the next copy.
TEST_F(SessionBackupTest, InThePlaceOfOneThatWasInterruptedItIsWhole) {
  Draws draws(10);
  int interrupted = 0;
  for (int round = 0; round < 30 && interrupted < 3; ++round) {
    BackUpUntilKilled(&draws);
    if (fs::exists(Path("backup-journal"))) ++interrupted;
    SessionBackup(File(), Copy()).Update();
    EXPECT_FALSE(fs::exists(Path("backup-journal")));
    EXPECT_EQ(AllRows(Copy()), AllRows(File()));
  }
  EXPECT_GT(interrupted, 0);
}

}  // namespace
}  // namespace lamina
