#include "io/session_database.h"

#include <SQLiteCpp/Backup.h>
#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/format.h>
#include <sqlite3.h>

#include <cmath>
#include <filesystem>
#include <limits>

#include "core/error.h"
#include "core/state_archive.h"
#include "io/checksum.h"

namespace lamina {
namespace {

constexpr const char* kVersion = "1";
constexpr const char* kSchema =
    "CREATE TABLE IF NOT EXISTS meta(key TEXT PRIMARY KEY, value TEXT NOT NULL);"
    "CREATE TABLE IF NOT EXISTS scans("
    " scan INTEGER PRIMARY KEY, file BLOB NOT NULL UNIQUE, sequence BLOB NOT NULL,"
    " stamp_ns INTEGER NOT NULL, recorded_stamp INTEGER NOT NULL, skipped INTEGER NOT NULL,"
    " final INTEGER NOT NULL, pose BLOB NOT NULL, crc INTEGER NOT NULL, status TEXT NOT NULL,"
    " detail TEXT NOT NULL, keyframe INTEGER NOT NULL, searched INTEGER NOT NULL,"
    " points INTEGER NOT NULL, clusters INTEGER NOT NULL, matched INTEGER NOT NULL,"
    " iterations INTEGER NOT NULL, unobservable_directions INTEGER NOT NULL,"
    " inlier_share REAL, residual_m REAL, worst_sigma_m REAL,"
    " covariance BLOB NOT NULL, read_ms REAL, prepare_ms REAL,"
    " cluster_ms REAL, odometry_ms REAL, map_ms REAL,"
    " solve_ms REAL, next_stamp_ns INTEGER);"
    "CREATE INDEX IF NOT EXISTS sequences ON scans(sequence, scan);"
    "CREATE TABLE IF NOT EXISTS solves("
    " before_scan INTEGER NOT NULL, frames INTEGER NOT NULL, planes INTEGER NOT NULL,"
    " observations INTEGER NOT NULL, iterations INTEGER NOT NULL, usable INTEGER NOT NULL,"
    " initial_cost REAL, final_cost REAL, solve_ms REAL);"
    "CREATE INDEX IF NOT EXISTS solve_order ON solves(before_scan);"
    "CREATE TABLE IF NOT EXISTS set_aside(file BLOB PRIMARY KEY, reason TEXT NOT NULL)"
    " WITHOUT ROWID;";

std::string Blob(SE3 T) {
  StateArchive a;
  a(&T);
  return a.written();
}

std::string Blob(Matrix6d m) {
  StateArchive a;
  a(&m);
  return a.written();
}

std::uint32_t Checksum(SessionScan s) {
  for (double* value : {&s.inlier_share, &s.residual_m, &s.worst_sigma_m, &s.read_ms, &s.prepare_ms,
                        &s.cluster_ms, &s.odometry_ms, &s.map_ms, &s.solve_ms}) {
    // As it comes back: SQLite knows one NaN and one zero.
    *value = std::isnan(*value) ? std::numeric_limits<double>::quiet_NaN() : *value + 0.0;
  }
  bool has_next = s.next_stamp_ns.has_value();
  StampNs next_stamp_ns = s.next_stamp_ns.value_or(0);
  StateArchive a;
  a(&s.scan, &s.file, &s.sequence, &s.stamp_ns, &s.recorded_stamp, &has_next, &next_stamp_ns,
    &s.skipped, &s.final, &s.T_world_lidar, &s.status, &s.detail, &s.keyframe, &s.searched,
    &s.points, &s.clusters, &s.matched, &s.iterations, &s.unobservable_directions, &s.inlier_share,
    &s.residual_m, &s.worst_sigma_m, &s.covariance, &s.read_ms, &s.prepare_ms, &s.cluster_ms,
    &s.odometry_ms, &s.map_ms, &s.solve_ms);
  return Crc32(a.written());
}

std::string BytesOf(const SQLite::Column& column) {
  return std::string(static_cast<const char*>(column.getBlob()),
                     static_cast<std::size_t>(column.getBytes()));
}

template <typename T>
T FromBlob(const std::string& bytes) {
  T value;
  StateArchive a{std::string_view(bytes)};
  a(&value);
  if (a.unread() > 0) throw InputError("a blob is longer than it should be");
  return value;
}

// Binds or reads the columns of a row one after the other, so that their order has one home.
class ColumnBinder {
 public:
  explicit ColumnBinder(SQLite::Statement* statement) : statement_(statement) {}
  void Blob(const std::string& bytes) {
    statement_->bind(++i_, bytes.data(), static_cast<int>(bytes.size()));
  }
  void Text(const std::string& text) { statement_->bind(++i_, text); }
  void Number(std::int64_t value) { statement_->bind(++i_, value); }
  // SQLite makes NULL of NaN.
  void Number(double value) { statement_->bind(++i_, value); }
  void Number(bool value) { statement_->bind(++i_, value ? 1 : 0); }
  void NumberOrNull(const std::optional<std::int64_t>& value) {
    if (value) {
      Number(*value);
    } else {
      statement_->bind(++i_);
    }
  }
  void Execute() {
    statement_->exec();
    statement_->reset();
  }

 private:
  SQLite::Statement* statement_;
  int i_ = 0;
};

class ColumnReader {
 public:
  explicit ColumnReader(SQLite::Statement* statement) : statement_(statement) {}
  std::string Blob() { return BytesOf(statement_->getColumn(i_++)); }
  std::string Text() { return statement_->getColumn(i_++).getString(); }
  std::int64_t Whole() { return statement_->getColumn(i_++).getInt64(); }
  std::optional<std::int64_t> WholeOrNull() {
    const SQLite::Column column = statement_->getColumn(i_++);
    return column.isNull() ? std::nullopt : std::make_optional(column.getInt64());
  }
  double Real() {
    const SQLite::Column column = statement_->getColumn(i_++);
    return column.isNull() ? std::numeric_limits<double>::quiet_NaN() : column.getDouble();
  }
  bool Flag() { return Whole() != 0; }

 private:
  SQLite::Statement* statement_;
  int i_ = 0;
};

// Throws InputError.
SessionScan ReadScan(SQLite::Statement* statement) {
  ColumnReader row(statement);
  SessionScan s;
  s.scan = row.Whole();
  s.file = row.Blob();
  s.sequence = row.Blob();
  s.stamp_ns = row.Whole();
  s.recorded_stamp = row.Flag();
  s.skipped = row.Flag();
  s.final = row.Flag();
  s.T_world_lidar = FromBlob<SE3>(row.Blob());
  const auto crc = static_cast<std::uint32_t>(row.Whole());
  s.status = row.Text();
  s.detail = row.Text();
  s.keyframe = row.Flag();
  s.searched = row.Flag();
  for (std::int64_t* value :
       {&s.points, &s.clusters, &s.matched, &s.iterations, &s.unobservable_directions}) {
    *value = row.Whole();
  }
  for (double* value : {&s.inlier_share, &s.residual_m, &s.worst_sigma_m}) *value = row.Real();
  s.covariance = FromBlob<Matrix6d>(row.Blob());
  for (double* value :
       {&s.read_ms, &s.prepare_ms, &s.cluster_ms, &s.odometry_ms, &s.map_ms, &s.solve_ms}) {
    *value = row.Real();
  }
  s.next_stamp_ns = row.WholeOrNull();
  if (crc != Checksum(s)) throw InputError("its checksum differs");
  return s;
}

}  // namespace

struct SessionDatabase::Impl {
  explicit Impl(const std::string& file)
      : path(file), database(file, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE) {
    database.setBusyTimeout(30000);
    RefuseForeign();
    // The log is brought into the file by Tidy(), on a thread that has time.
    database.exec(
        "PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA wal_autocheckpoint=0;"
        "PRAGMA journal_size_limit=67108864;");
    database.exec(kSchema);
    put_scan.emplace(database,
                     "INSERT OR REPLACE INTO scans VALUES(?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,"
                     "?,?,?,?,?,?,?,?,?)");
    put_solve.emplace(database, "INSERT INTO solves VALUES(?,?,?,?,?,?,?,?,?)");
    row_of.emplace(database, "SELECT * FROM scans WHERE scan = ?");
    finalise.emplace(database, "UPDATE scans SET pose = ?, crc = ?, final = 1 WHERE scan = ?");
    knows.emplace(database,
                  "SELECT 1 FROM scans WHERE file = ?1 UNION ALL SELECT 1 FROM set_aside WHERE "
                  "file = ?1");
    put_aside.emplace(database, "INSERT OR REPLACE INTO set_aside VALUES(?,?)");
  }

  template <typename Work>
  auto Guarded(const char* doing, const Work& work) const {
    try {
      return work();
    } catch (const SQLite::Exception& error) {
      throw OutputError(fmt::format("{}: {}: {}", path, doing, error.what()));
    }
  }

  void Check() {
    // Not the quick one, which leaves out whether the indexes fit the rows: a name that the index
    // has lost would be mapped again.
    SQLite::Statement check(database, "PRAGMA integrity_check(1)");
    check.executeStep();
    const std::string answer = check.getColumn(0).getString();
    if (answer != "ok") throw InputError(fmt::format("{}: is damaged: {}", path, answer));
  }

  // Before anything is made in it: a database of somebody else's must stay as it is.
  void RefuseForeign() const {
    SQLite::Statement others(
        database,
        "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT GLOB 'sqlite_*' AND name "
        "NOT IN ('meta', 'scans', 'solves', 'set_aside') LIMIT 1");
    if (!others.executeStep()) return;
    throw InputError(fmt::format("{}: is no session's database: it has a table '{}'", path,
                                 others.getColumn(0).getString()));
  }

  SessionScan Row(SQLite::Statement* rows) const {
    try {
      return ReadScan(rows);
    } catch (const InputError& error) {
      throw InputError(fmt::format("{}: the row of scan {} is damaged: {}", path,
                                   rows->getColumn(0).getInt64(), error.what()));
    }
  }

  std::int64_t Number(const char* query) const {
    SQLite::Statement statement(database, query);
    statement.executeStep();
    return statement.getColumn(0).getInt64();
  }

  std::string path;
  SQLite::Database database;
  std::optional<SQLite::Statement> put_scan, put_solve, row_of, finalise, put_aside;
  mutable std::optional<SQLite::Statement> knows;
  std::optional<SQLite::Transaction> transaction;
};

SessionDatabase::SessionDatabase(const std::string& path, bool check) {
  try {
    impl_ = std::make_unique<Impl>(path);
    if (check) impl_->Check();
  } catch (const SQLite::Exception& error) {
    const int code = error.getErrorCode();
    // SQLITE_ERROR: a table is there, but has other columns.
    if (code == SQLITE_NOTADB || code == SQLITE_CORRUPT || code == SQLITE_ERROR) {
      throw InputError(fmt::format("{}: is damaged: {}", path, error.what()));
    }
    throw OutputError(fmt::format("{}: cannot be opened: {}", path, error.what()));
  }
  const std::optional<std::string> version = Meta("version");
  if (!version) SetMeta("version", kVersion);
  if (version && *version != kVersion) {
    throw InputError(fmt::format("{}: is of version {}, this program reads version {}", path,
                                 *version, kVersion));
  }
  if (check) ForEach(0, scans(), [](const SessionScan&) {});
}

SessionDatabase::~SessionDatabase() = default;

std::optional<std::string> SessionDatabase::Meta(const std::string& key) const {
  return impl_->Guarded("cannot be read", [&]() -> std::optional<std::string> {
    SQLite::Statement get(impl_->database, "SELECT value FROM meta WHERE key = ?");
    get.bind(1, key);
    if (!get.executeStep()) return std::nullopt;
    return get.getColumn(0).getString();
  });
}

void SessionDatabase::SetMeta(const std::string& key, const std::string& value) {
  impl_->Guarded("cannot be written", [&] {
    SQLite::Statement set(impl_->database, "INSERT OR REPLACE INTO meta VALUES(?,?)");
    set.bind(1, key);
    set.bind(2, value);
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

void SessionDatabase::Put(const SessionScan& s) {
  impl_->Guarded("cannot be written", [&] {
    ColumnBinder row(&*impl_->put_scan);
    row.Number(s.scan);
    row.Blob(s.file);
    row.Blob(s.sequence);
    row.Number(s.stamp_ns);
    row.Number(s.recorded_stamp);
    row.Number(s.skipped);
    row.Number(s.final);
    row.Blob(Blob(s.T_world_lidar));
    row.Number(std::int64_t{Checksum(s)});
    row.Text(s.status);
    row.Text(s.detail);
    row.Number(s.keyframe);
    row.Number(s.searched);
    for (const std::int64_t value :
         {s.points, s.clusters, s.matched, s.iterations, s.unobservable_directions}) {
      row.Number(value);
    }
    for (const double value : {s.inlier_share, s.residual_m, s.worst_sigma_m}) row.Number(value);
    row.Blob(Blob(s.covariance));
    for (const double value :
         {s.read_ms, s.prepare_ms, s.cluster_ms, s.odometry_ms, s.map_ms, s.solve_ms}) {
      row.Number(value);
    }
    row.NumberOrNull(s.next_stamp_ns);
    row.Execute();
  });
}

void SessionDatabase::Put(const SessionSolve& s) {
  impl_->Guarded("cannot be written", [&] {
    ColumnBinder row(&*impl_->put_solve);
    for (const std::int64_t value :
         {s.before_scan, s.frames, s.planes, s.observations, s.iterations}) {
      row.Number(value);
    }
    row.Number(s.usable);
    for (const double value : {s.initial_cost, s.final_cost, s.solve_ms}) row.Number(value);
    row.Execute();
  });
}

void SessionDatabase::Finalise(const SessionPose& pose) {
  impl_->Guarded("cannot be written", [&] {
    impl_->row_of->bind(1, pose.scan);
    if (!impl_->row_of->executeStep()) {
      impl_->row_of->reset();
      throw std::logic_error(fmt::format("pose of unknown scan {}", pose.scan));
    }
    SessionScan scan = impl_->Row(&*impl_->row_of);
    impl_->row_of->reset();
    if (pose.skipped && !scan.skipped) return;
    scan.T_world_lidar = pose.T_world_lidar;
    scan.final = true;
    ColumnBinder row(&*impl_->finalise);
    row.Blob(Blob(scan.T_world_lidar));
    row.Number(std::int64_t{Checksum(scan)});
    row.Number(scan.scan);
    row.Execute();
  });
}

void SessionDatabase::SetAside(const std::string& file, const std::string& reason) {
  impl_->Guarded("cannot be written", [&] {
    ColumnBinder row(&*impl_->put_aside);
    row.Blob(file);
    row.Text(reason);
    row.Execute();
  });
}

bool SessionDatabase::Knows(const std::string& file) const {
  return impl_->Guarded("cannot be read", [&] {
    ColumnBinder(&*impl_->knows).Blob(file);
    const bool found = impl_->knows->executeStep();
    impl_->knows->reset();
    return found;
  });
}

std::int64_t SessionDatabase::scans() const {
  return impl_->Guarded("cannot be read", [&] {
    return impl_->Number("SELECT IFNULL(MAX(scan) + 1, 0) FROM scans");
  });
}

std::int64_t SessionDatabase::set_aside() const {
  return impl_->Guarded("cannot be read",
                        [&] { return impl_->Number("SELECT COUNT(*) FROM set_aside"); });
}

void SessionDatabase::ForEach(std::int64_t from, std::int64_t to,
                              const std::function<void(const SessionScan&)>& visit) const {
  impl_->Guarded("cannot be read", [&] {
    SQLite::Statement rows(impl_->database,
                           "SELECT * FROM scans WHERE scan >= ? AND scan < ? ORDER BY scan");
    rows.bind(1, from);
    rows.bind(2, to);
    while (rows.executeStep()) visit(impl_->Row(&rows));
  });
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
      ForEach(last, last + 1, [&](const SessionScan& scan) { sequence.last = scan; });
      sequences.push_back(std::move(sequence));
    }
    return sequences;
  });
}

void SessionDatabase::DropSolvesFrom(std::int64_t scan) {
  impl_->Guarded("cannot be written", [&] {
    SQLite::Statement drop(impl_->database, "DELETE FROM solves WHERE before_scan >= ?");
    drop.bind(1, scan);
    drop.exec();
  });
}

void SessionDatabase::Tidy() {
  impl_->Guarded("cannot be written", [&] {
    SQLite::Statement tidy(impl_->database, "PRAGMA wal_checkpoint(PASSIVE)");
    while (tidy.executeStep()) {
    }
  });
}

void SessionDatabase::BackUpTo(const std::string& path) const {
  const std::string partial = path + ".partial";
  std::error_code error;
  std::filesystem::remove(partial, error);
  impl_->Guarded("cannot be copied", [&] {
    SQLite::Database copy(partial, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    SQLite::Backup backup(copy, impl_->database);
    backup.executeStep(-1);
    // A file of its own, that needs no log beside it.
    copy.exec("PRAGMA journal_mode=DELETE");
  });
  std::filesystem::rename(partial, path, error);
  if (error) throw OutputError(fmt::format("{}: cannot be renamed to: {}", path, error.message()));
}

}  // namespace lamina
