#include "io/store/session_rows.h"

#include <cmath>
#include <limits>

#include "core/base/error.h"
#include "core/geometry/state_archive.h"
#include "io/file/checksum.h"

namespace lamina {

const char* const kSessionSchema =
    "CREATE TABLE IF NOT EXISTS meta(key TEXT PRIMARY KEY, value TEXT NOT NULL);"
    "CREATE TABLE IF NOT EXISTS scans("
    " scan INTEGER PRIMARY KEY, file BLOB NOT NULL UNIQUE, sequence BLOB NOT NULL,"
    " stamp_ns INTEGER NOT NULL, recorded_stamp INTEGER NOT NULL, skipped INTEGER NOT NULL,"
    " piece INTEGER NOT NULL,"
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

const std::array<const char*, 5> kAddToCopy = {
    "INSERT OR REPLACE INTO main.meta SELECT * FROM session.meta",
    "INSERT OR REPLACE INTO main.scans SELECT * FROM session.scans WHERE scan >= ? ORDER BY scan",
    "DELETE FROM main.solves WHERE before_scan >= ?",
    "INSERT INTO main.solves SELECT * FROM session.solves WHERE before_scan >= ? ORDER BY "
    "before_scan, rowid",
    "INSERT OR IGNORE INTO main.set_aside SELECT * FROM session.set_aside"};

const char* const kPutScan =
    "INSERT OR REPLACE INTO scans "
    "VALUES(?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)";
const char* const kPutSolve = "INSERT INTO solves VALUES(?,?,?,?,?,?,?,?,?)";
const char* const kFinaliseScan =
    "UPDATE scans SET pose = ?, status = ?, unobservable_directions = ?, crc = ?, final = 1 "
    "WHERE scan = ?";

namespace {

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

std::uint32_t Checksum(ScanRecord s) {
  for (double* value : {&s.inlier_share, &s.residual_m, &s.worst_sigma_m, &s.read_ms, &s.prepare_ms,
                        &s.cluster_ms, &s.odometry_ms, &s.map_ms, &s.solve_ms}) {
    // As it comes back: SQLite knows one NaN and one zero.
    *value = std::isnan(*value) ? std::numeric_limits<double>::quiet_NaN() : *value + 0.0;
  }
  bool has_next = s.next_stamp_ns.has_value();
  StampNs next_stamp_ns = s.next_stamp_ns.value_or(0);
  StateArchive a;
  a(&s.scan, &s.file, &s.sequence, &s.stamp_ns, &s.recorded_stamp, &has_next, &next_stamp_ns,
    &s.skipped, &s.piece, &s.final, &s.T_world_lidar, &s.status, &s.detail, &s.keyframe,
    &s.searched, &s.points, &s.clusters, &s.matched, &s.iterations, &s.unobservable_directions,
    &s.inlier_share, &s.residual_m, &s.worst_sigma_m, &s.covariance, &s.read_ms, &s.prepare_ms,
    &s.cluster_ms, &s.odometry_ms, &s.map_ms, &s.solve_ms);
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
  void Blob(const std::string& bytes) { BindBlob(++i_, bytes, statement_); }
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

}  // namespace

void BindBlob(int place, const std::string& bytes, SQLite::Statement* statement) {
  statement->bind(place, bytes.data(), static_cast<int>(bytes.size()));
}

void PutRow(const ScanRecord& s, SQLite::Statement* statement) {
  ColumnBinder row(statement);
  row.Number(s.scan);
  row.Blob(s.file);
  row.Blob(s.sequence);
  row.Number(s.stamp_ns);
  row.Number(s.recorded_stamp);
  row.Number(s.skipped);
  row.Number(s.piece);
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
}

void PutRow(const SessionSolve& s, SQLite::Statement* statement) {
  ColumnBinder row(statement);
  for (const std::int64_t value :
       {s.before_scan, s.frames, s.planes, s.observations, s.iterations}) {
    row.Number(value);
  }
  row.Number(s.usable);
  for (const double value : {s.initial_cost, s.final_cost, s.solve_ms}) row.Number(value);
  row.Execute();
}

void FinaliseRow(const ScanRecord& scan, SQLite::Statement* statement) {
  ColumnBinder row(statement);
  row.Blob(Blob(scan.T_world_lidar));
  row.Text(scan.status);
  row.Number(scan.unobservable_directions);
  row.Number(std::int64_t{Checksum(scan)});
  row.Number(scan.scan);
  row.Execute();
}

ScanRecord ReadScanRow(SQLite::Statement* statement) {
  ColumnReader row(statement);
  ScanRecord s;
  s.scan = row.Whole();
  s.file = row.Blob();
  s.sequence = row.Blob();
  s.stamp_ns = row.Whole();
  s.recorded_stamp = row.Flag();
  s.skipped = row.Flag();
  s.piece = row.Whole();
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

}  // namespace lamina
