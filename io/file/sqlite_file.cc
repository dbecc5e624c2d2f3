#include "io/file/sqlite_file.h"

#include <fmt/format.h>
#include <sqlite3.h>

#include <filesystem>

#include "core/base/error.h"
#include "io/file/disk_room.h"

namespace lamina {
namespace {

// SQLITE_FULL is told for the file itself. Where the index of its log, or a new file, finds no
// room, SQLite names that an error of input and output.
bool IsFullDisk(const std::string& path, const SQLite::Exception& error) {
  if (error.getErrorCode() == SQLITE_FULL) return true;
  if (error.getErrorCode() != SQLITE_IOERR && error.getErrorCode() != SQLITE_CANTOPEN) return false;
  constexpr std::uint64_t kNoRoomBytes = 64 << 10;  // less than the index takes
  const auto folder = std::filesystem::path(path).parent_path();
  std::error_code ignored;
  return std::filesystem::exists(folder, ignored) && FreeBytes(folder.string()) < kNoRoomBytes;
}

[[noreturn]] void ThrowOutput(const std::string& path, const char* doing,
                              const SQLite::Exception& error) {
  const std::string text = fmt::format("{}: {}: {}", path, doing, error.what());
  if (IsFullDisk(path, error)) throw DiskFullError(text);
  throw OutputError(text);
}

}  // namespace

bool IsDamage(const SQLite::Exception& error) {
  return error.getErrorCode() == SQLITE_NOTADB || error.getErrorCode() == SQLITE_CORRUPT;
}

void ThrowNotOpened(const std::string& path, const SQLite::Exception& error) {
  // SQLITE_ERROR: a table is there, but has other columns.
  if (IsDamage(error) || error.getErrorCode() == SQLITE_ERROR) {
    throw InputError(fmt::format("{}: is damaged: {}", path, error.what()));
  }
  ThrowOutput(path, "cannot be opened", error);
}

void ThrowFailed(const std::string& path, const char* doing, const SQLite::Exception& error) {
  ThrowOutput(path, doing, error);
}

std::string UntouchedUri(const std::string& path) {
  std::string uri = "file:";
  for (const char c : path) {
    uri += c == '%' || c == '?' || c == '#' ? fmt::format("%{:02x}", c) : std::string(1, c);
  }
  return uri + (std::filesystem::exists(path + "-wal") ? "?mode=ro" : "?mode=ro&immutable=1");
}

SQLite::Database OpenUntouched(const std::string& path) {
  return SQLite::Database(UntouchedUri(path), SQLite::OPEN_READONLY | SQLite::OPEN_URI);
}

void BringLogIntoFile(SQLite::Database* database) {
  SQLite::Statement statement(*database, "PRAGMA wal_checkpoint(PASSIVE)");
  while (statement.executeStep()) {
  }
}

LogLimit::LogLimit(SQLite::Database* database, std::size_t most_bytes)
    : database_(database), most_bytes_(most_bytes), limit_bytes_(most_bytes) {
  page_bytes_ = static_cast<std::size_t>(database->execAndGet("PRAGMA page_size").getInt64());
  // SQLite tells the pages in the log after each commit.
  const auto committed = [](void* limit, sqlite3*, const char*, int pages) {
    auto* const self = static_cast<LogLimit*>(limit);
    self->log_bytes_ = static_cast<std::size_t>(pages) * self->page_bytes_;
    return SQLITE_OK;
  };
  sqlite3_wal_hook(database->getHandle(), committed, this);
}

void LogLimit::Keep() {
  if (log_bytes_ < most_bytes_) limit_bytes_ = most_bytes_;
  if (log_bytes_ < limit_bytes_) return;
  limit_bytes_ = log_bytes_ + most_bytes_ / 8;
  const int timeout_ms = database_->execAndGet("PRAGMA busy_timeout").getInt();
  database_->setBusyTimeout(0);
  try {
    // A row tells whether another connection was in the way.
    database_->execAndGet("PRAGMA wal_checkpoint(RESTART)");
  } catch (...) {
    database_->setBusyTimeout(timeout_ms);
    throw;
  }
  database_->setBusyTimeout(timeout_ms);
}

}  // namespace lamina
