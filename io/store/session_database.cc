#include "io/store/session_database.h"

#include <SQLiteCpp/Backup.h>
#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "core/base/error.h"
#include "io/file/checksum.h"
#include "io/file/disk_room.h"
#include "io/file/file_writer.h"
#include "io/file/sqlite_file.h"
#include "io/store/session_rows.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

constexpr const char* kDatabaseVersion = "2";
// More than is written between two checkpoints of a session: mostly Tidy() does it, beside the
// writer.
constexpr std::size_t kMostDatabaseLogBytes = 8 << 20;

// The row of `meta` behind that of a key. There is none in sessions of older programs.
constexpr const char* kChecksum = ".crc32";
std::string ChecksumOf(const std::string& value) { return std::to_string(Crc32(value)); }

ScanRecord ReadRow(const std::string& path, SQLite::Statement* rows) {
  try {
    return ReadScanRow(rows);
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: the row of scan {} is damaged: {}", path,
                                 rows->getColumn(0).getInt64(), error.what()));
  }
}

void VisitScans(const std::string& path, const SQLite::Database& database, std::int64_t from,
                std::int64_t to, const std::function<void(const ScanRecord&)>& visit) {
  SQLite::Statement rows(database,
                         "SELECT * FROM scans WHERE scan >= ? AND scan < ? ORDER BY scan");
  rows.bind(1, from);
  rows.bind(2, to);
  while (rows.executeStep()) visit(ReadRow(path, &rows));
}

}  // namespace

struct SessionDatabase::Impl {
  explicit Impl(const std::string& file)
      : path(file), database(file, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE) {
    database.setBusyTimeout(30000);
    RefuseForeign();
    RefuseOtherVersion();
    // The log is brought into the file by Tidy(), on a thread that has time.
    database.exec(
        "PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA wal_autocheckpoint=0;"
        "PRAGMA journal_size_limit=67108864;");
    database.exec(kSessionSchema);
    put_scan.emplace(database, kPutScan);
    put_solve.emplace(database, kPutSolve);
    row_of.emplace(database, "SELECT * FROM scans WHERE scan = ?");
    finalise.emplace(database, kFinaliseScan);
    knows.emplace(database,
                  "SELECT 1 FROM scans WHERE file = ?1 UNION ALL SELECT 1 FROM set_aside WHERE "
                  "file = ?1");
    put_aside.emplace(database, "INSERT OR REPLACE INTO set_aside VALUES(?,?)");
    log_limit.emplace(&database, kMostDatabaseLogBytes);
  }

  template <typename Work>
  auto Guarded(const char* doing, const Work& work) const {
    return OnSqlite(path, doing, work);
  }

  void Check() {
    // Not the quick one, which leaves out whether the indexes fit the rows: a name that the index
    // has lost would be mapped again.
    SQLite::Statement check(database, "PRAGMA integrity_check(1)");
    check.executeStep();
    const std::string answer = check.getColumn(0).getString();
    if (answer != "ok") throw InputError(fmt::format("{}: is damaged: {}", path, answer));
  }

  // Before anything is made in it, or a table is taken for what it is in this version.
  void RefuseOtherVersion() const {
    if (!database.tableExists("meta")) return;
    SQLite::Statement get(database, "SELECT value FROM meta WHERE key = 'version'");
    if (!get.executeStep() || get.getColumn(0).getString() == kDatabaseVersion) return;
    throw OtherFormatError(fmt::format(
        "{}: is of version {}, this program reads version {}: finish the session with the program "
        "that made it, or map its scans in a new one",
        path, get.getColumn(0).getString(), kDatabaseVersion));
  }

  // Before anything is made in it: the database of another program must stay as it is.
  void RefuseForeign() const {
    SQLite::Statement others(
        database,
        "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT GLOB 'sqlite_*' AND name "
        "NOT IN ('meta', 'scans', 'solves', 'set_aside') LIMIT 1");
    if (!others.executeStep()) return;
    throw OtherFormatError(fmt::format("{}: is no session's database: it has a table '{}'", path,
                                       others.getColumn(0).getString()));
  }

  ScanRecord Row(SQLite::Statement* rows) const { return ReadRow(path, rows); }

  std::int64_t Number(const char* query) const {
    SQLite::Statement statement(database, query);
    statement.executeStep();
    return statement.getColumn(0).getInt64();
  }

  // Of the database without its log.
  std::uint64_t Bytes() const {
    return Guarded("cannot be read", [&] {
      return static_cast<std::uint64_t>(Number("PRAGMA page_count") * Number("PRAGMA page_size"));
    });
  }

  std::string path;
  SQLite::Database database;
  std::optional<SQLite::Statement> put_scan, put_solve, row_of, finalise, put_aside;
  mutable std::optional<SQLite::Statement> knows;
  std::optional<SQLite::Transaction> transaction;
  std::optional<LogLimit> log_limit;
};

SessionDatabase::SessionDatabase(const std::string& path, bool check) {
  OpenSqlite(path, [&] {
    impl_ = std::make_unique<Impl>(path);
    if (check) impl_->Check();
  });
  if (!Meta("version")) SetMeta("version", kDatabaseVersion);
  if (check) ForEach(0, scans(), [](const ScanRecord&) {});
}

SessionDatabase::~SessionDatabase() = default;

std::optional<std::string> SessionDatabase::Meta(const std::string& key) const {
  const auto value_of = [this](const std::string& name) -> std::optional<std::string> {
    SQLite::Statement get(impl_->database, "SELECT value FROM meta WHERE key = ?");
    get.bind(1, name);
    if (!get.executeStep()) return std::nullopt;
    return get.getColumn(0).getString();
  };
  return impl_->Guarded("cannot be read", [&] {
    const std::optional<std::string> value = value_of(key), checksum = value_of(key + kChecksum);
    if (value && checksum && *checksum != ChecksumOf(*value)) {
      throw InputError(
          fmt::format("{}: is damaged: the checksum of '{}' differs", impl_->path, key));
    }
    return value;
  });
}

void SessionDatabase::SetMeta(const std::string& key, const std::string& value) {
  impl_->Guarded("cannot be written", [&] {
    SQLite::Statement set(impl_->database, "INSERT OR REPLACE INTO meta VALUES(?,?),(?,?)");
    set.bind(1, key);
    set.bind(2, value);
    set.bind(3, key + kChecksum);
    set.bind(4, ChecksumOf(value));
    set.exec();
  });
}

void SessionDatabase::Begin() {
  // Immediate: a transaction that reads first and then wants to write cannot wait for a writer that
  // came in between (SQLite: BUSY_SNAPSHOT); one that is a writer from the start can.
  impl_->Guarded("cannot be written", [&] {
    impl_->transaction.emplace(impl_->database, SQLite::TransactionBehavior::IMMEDIATE);
  });
}

void SessionDatabase::Commit() {
  impl_->Guarded("cannot be written", [&] {
    impl_->transaction->commit();
    impl_->transaction.reset();
  });
}

void SessionDatabase::Put(const ScanRecord& scan) {
  impl_->Guarded("cannot be written", [&] { PutRow(scan, &*impl_->put_scan); });
}

void SessionDatabase::Put(const SessionSolve& solve) {
  impl_->Guarded("cannot be written", [&] { PutRow(solve, &*impl_->put_solve); });
}

void SessionDatabase::Finalise(const SessionPose& pose) {
  impl_->Guarded("cannot be written", [&] {
    impl_->row_of->bind(1, pose.scan);
    if (!impl_->row_of->executeStep()) {
      impl_->row_of->reset();
      throw std::logic_error(fmt::format("pose of unknown scan {}", pose.scan));
    }
    ScanRecord scan = impl_->Row(&*impl_->row_of);
    impl_->row_of->reset();
    if (pose.skipped && !scan.skipped) return;
    scan.T_world_lidar = pose.T_world_lidar;
    scan.final = true;
    if (pose.given_up) scan.GiveUp();
    FinaliseRow(scan, &*impl_->finalise);
  });
}

void SessionDatabase::SetAside(const std::string& file, const std::string& reason) {
  impl_->Guarded("cannot be written", [&] {
    BindBlob(1, file, &*impl_->put_aside);
    impl_->put_aside->bind(2, reason);
    impl_->put_aside->exec();
    impl_->put_aside->reset();
  });
}

bool SessionDatabase::Knows(const std::string& file) const {
  return impl_->Guarded("cannot be read", [&] {
    BindBlob(1, file, &*impl_->knows);
    const bool found = impl_->knows->executeStep();
    impl_->knows->reset();
    return found;
  });
}

std::int64_t SessionDatabase::scans() const {
  return impl_->Guarded("cannot be read", [&] { return impl_->Number(kCountScans); });
}

std::int64_t SessionDatabase::set_aside() const {
  return impl_->Guarded("cannot be read",
                        [&] { return impl_->Number("SELECT COUNT(*) FROM set_aside"); });
}

void SessionDatabase::ForEach(std::int64_t from, std::int64_t to,
                              const std::function<void(const ScanRecord&)>& visit) const {
  impl_->Guarded("cannot be read",
                 [&] { VisitScans(impl_->path, impl_->database, from, to, visit); });
}

void ForEachScanOf(const std::string& path, std::int64_t to,
                   const std::function<void(const ScanRecord&)>& visit) {
  OnSqlite(path, "cannot be read", [&] { VisitScans(path, OpenUntouched(path), 0, to, visit); });
}

std::vector<SessionDatabase::Sequence> SessionDatabase::Sequences(std::int64_t to) const {
  return impl_->Guarded("cannot be read", [&] {
    std::vector<Sequence> sequences;
    SQLite::Statement rows(
        impl_->database,
        "SELECT MAX(scan), COUNT(*) FROM scans WHERE scan < ? GROUP BY sequence ORDER BY 1");
    rows.bind(1, to);
    while (rows.executeStep()) {
      Sequence sequence;
      sequence.scans = rows.getColumn(1).getInt64();
      const std::int64_t last = rows.getColumn(0).getInt64();
      ForEach(last, last + 1, [&](const ScanRecord& scan) { sequence.last = scan; });
      sequences.push_back(std::move(sequence));
    }
    return sequences;
  });
}

std::vector<ScanRecord> SessionDatabase::LastOf(const std::string& sequence, std::int64_t to,
                                                int most) const {
  return impl_->Guarded("cannot be read", [&] {
    std::vector<ScanRecord> scans;
    SQLite::Statement rows(
        impl_->database,
        "SELECT * FROM scans WHERE sequence = ? AND scan < ? ORDER BY scan DESC LIMIT ?");
    BindBlob(1, sequence, &rows);
    rows.bind(2, to);
    rows.bind(3, most);
    while (rows.executeStep()) scans.push_back(impl_->Row(&rows));
    std::reverse(scans.begin(), scans.end());
    return scans;
  });
}

void SessionDatabase::DropSolvesFrom(std::int64_t scan) {
  impl_->Guarded("cannot be written", [&] {
    SQLite::Statement drop(impl_->database, "DELETE FROM solves WHERE before_scan >= ?");
    drop.bind(1, scan);
    drop.exec();
  });
}

void SessionDatabase::LimitLog() {
  impl_->Guarded("cannot be written", [&] { impl_->log_limit->Keep(); });
}

void SessionDatabase::Tidy() {
  impl_->Guarded("cannot be written", [&] { BringLogIntoFile(&impl_->database); });
}

void SessionDatabase::BackUpTo(const std::string& path, std::uint64_t room_left) const {
  const std::string folder = fs::absolute(path).parent_path().string();
  const std::string partial = path + ".partial";
  const auto remove_partial = [&] {
    std::error_code ignored;
    for (const char* ending : {"", "-journal"}) fs::remove(partial + ending, ignored);
  };
  remove_partial();
  RequireRoom(path, impl_->Bytes() + room_left);
  try {
    OnSqlite(path, "cannot be written", [&] {
      SQLite::Database copy(partial, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
      SQLite::Backup backup(copy, impl_->database);
      backup.executeStep(-1);
      // A file of its own, that needs no log beside it.
      copy.exec("PRAGMA journal_mode=DELETE");
    });
    std::error_code error;
    fs::rename(partial, path, error);
    if (error) ThrowNotWritten(path, "cannot be renamed to", error.value());
  } catch (...) {
    remove_partial();
    throw;
  }
  SyncFolder(folder);
}

}  // namespace lamina
