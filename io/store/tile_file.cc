#include "io/store/tile_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "core/base/error.h"
#include "io/file/disk_room.h"
#include "io/file/file_writer.h"
#include "io/file/sqlite_file.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// Must come before the first table.
constexpr const char* kForm =
    "PRAGMA page_size=16384; PRAGMA auto_vacuum=INCREMENTAL; PRAGMA secure_delete=OFF;";
constexpr const char* kSchema =
    "CREATE TABLE IF NOT EXISTS voxels("
    " tile INTEGER NOT NULL, root INTEGER NOT NULL, stored_at INTEGER NOT NULL,"
    " taken_at INTEGER, crc INTEGER NOT NULL, record BLOB NOT NULL);"
    "CREATE INDEX IF NOT EXISTS here ON voxels(tile, root, stored_at) WHERE taken_at IS NULL;"
    "CREATE INDEX IF NOT EXISTS taken ON voxels(taken_at, stored_at) WHERE taken_at IS NOT NULL;"
    "CREATE TABLE IF NOT EXISTS totals(rows INTEGER NOT NULL, bytes INTEGER NOT NULL);"
    "INSERT INTO totals SELECT 0, 0 WHERE NOT EXISTS(SELECT 1 FROM totals);";
// With the journal in memory a crash may leave a scratch file in pieces, which is no loss.
constexpr const char* kScratch =
    "PRAGMA journal_mode=MEMORY; PRAGMA synchronous=OFF; PRAGMA locking_mode=EXCLUSIVE;";
// The journal is brought into the file by TileStore::SyncToDisk(), on a thread that has time.
constexpr const char* kKept =
    "PRAGMA journal_mode=WAL; PRAGMA synchronous=NORMAL; PRAGMA wal_autocheckpoint=0;"
    "PRAGMA journal_size_limit=33554432;";

bool IsOfAnOlderForm(const std::string& path) {
  if (!fs::exists(path)) return false;
  SQLite::Database database(path, SQLite::OPEN_READWRITE);
  return database.tableExists("voxels") && !database.tableExists("totals");
}

void WriteAnew(const std::string& path) {
  const std::string partial = path + ".partial";
  std::error_code ignored;
  fs::remove(partial, ignored);
  try {
    {
      SQLite::Database database(partial, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
      database.exec(kForm);
      SQLite::Statement attach(database, "ATTACH ? AS old");
      attach.bind(1, path);
      attach.exec();
      SQLite::Transaction transaction(database);
      database.exec(kSchema);
      database.exec(
          "INSERT INTO voxels SELECT tile, root, stored_at, taken_at, crc, record FROM old.voxels");
      transaction.commit();
    }
    // A log that is still there would be taken for that of the new file.
    if (fs::exists(path + "-wal")) {
      throw OutputError(fmt::format(
          "{}: is of an older form and cannot be replaced: another program has it open", path));
    }
    std::error_code error;
    fs::rename(partial, path, error);
    if (error) ThrowNotWritten(path, "cannot be replaced", error.value());
  } catch (...) {
    fs::remove(partial, ignored);
    throw;
  }
  SyncFolder(fs::absolute(path).parent_path().string());
}

SQLite::Database OpenInThisForm(const std::string& path) {
  if (IsOfAnOlderForm(path)) WriteAnew(path);
  return SQLite::Database(path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE | SQLite::OPEN_URI);
}

std::size_t Number(SQLite::Statement* statement) {
  const std::size_t number =
      statement->executeStep() ? static_cast<std::size_t>(statement->getColumn(0).getInt64()) : 0;
  statement->reset();
  return number;
}

}  // namespace

TileFile::TileFile(const std::string& path, Purpose purpose) : database_(OpenInThisForm(path)) {
  database_.setBusyTimeout(10000);
  database_.exec(kForm);
  database_.exec(purpose == Purpose::kScratch ? kScratch : kKept);
  database_.exec(kSchema);
  page_bytes_ = static_cast<std::size_t>(database_.execAndGet("PRAGMA page_size").getInt64());
  last_to_move_.emplace(database_,
                        "SELECT MAX(rowid) FROM (SELECT rowid FROM voxels ORDER BY rowid LIMIT ?)");
  copy_.emplace(database_,
                "INSERT INTO voxels SELECT tile, root, stored_at, taken_at, crc, record FROM "
                "voxels WHERE rowid <= ? ORDER BY rowid");
  remove_.emplace(database_, "DELETE FROM voxels WHERE rowid <= ?");
  pages_.emplace(database_, "PRAGMA page_count");
  free_pages_.emplace(database_, "PRAGMA freelist_count");
  totals_.emplace(database_, "UPDATE totals SET rows = ?, bytes = ?");
  const auto counted = static_cast<std::size_t>(
      database_
          .execAndGet("SELECT (SELECT COUNT(*) FROM voxels WHERE taken_at IS NULL) + (SELECT "
                      "COUNT(*) FROM voxels WHERE taken_at IS NOT NULL)")
          .getInt64());
  SQLite::Statement totals(database_, "SELECT rows, bytes FROM totals");
  if (totals.executeStep()) {
    rows_ = static_cast<std::size_t>(totals.getColumn(0).getInt64());
    bytes_ = static_cast<std::size_t>(totals.getColumn(1).getInt64());
  }
  if (rows_ != counted) Recount();
}

void TileFile::Recount() {
  SQLite::Statement count(database_, "SELECT COUNT(*), IFNULL(SUM(length(record)), 0) FROM voxels");
  count.executeStep();
  rows_ = static_cast<std::size_t>(count.getColumn(0).getInt64());
  bytes_ = static_cast<std::size_t>(count.getColumn(1).getInt64());
}

void TileFile::WriteTotals() {
  totals_->bind(1, static_cast<std::int64_t>(rows_));
  totals_->bind(2, static_cast<std::int64_t>(bytes_));
  totals_->exec();
  totals_->reset();
}

void TileFile::Tidy(std::size_t most) {
  constexpr std::size_t kRowBytes = 80;  // with its places in the indexes
  constexpr std::size_t kSparePages = 16;
  const std::size_t full = bytes_ + rows_ * kRowBytes;
  const std::size_t used = (Number(&*pages_) - Number(&*free_pages_)) * page_bytes_;
  if (used > full + full / 8 + kSparePages * page_bytes_) MoveFirstRows(2 * most);
  // What comes next takes free pages: some are left to it.
  const std::size_t pages = Number(&*pages_), free = Number(&*free_pages_);
  const std::size_t spare = kSparePages + pages / 16;
  if (free <= spare) return;
  SQLite::Statement vacuum(
      database_, fmt::format("PRAGMA incremental_vacuum({})", std::min(free - spare, most)));
  while (vacuum.executeStep()) {
  }
}

void TileFile::MoveFirstRows(std::size_t most) {
  last_to_move_->bind(1, static_cast<std::int64_t>(most));
  const auto last = static_cast<std::int64_t>(Number(&*last_to_move_));
  for (SQLite::Statement* statement : {&*copy_, &*remove_}) {
    statement->bind(1, last);
    statement->exec();
    statement->reset();
  }
}

}  // namespace lamina
