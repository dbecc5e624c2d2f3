#include "io/sqlite_file.h"

#include <fmt/format.h>
#include <sqlite3.h>

#include "core/error.h"

namespace lamina {

bool IsDamage(const SQLite::Exception& error) {
  return error.getErrorCode() == SQLITE_NOTADB || error.getErrorCode() == SQLITE_CORRUPT;
}

void ThrowNotOpened(const std::string& path, const SQLite::Exception& error) {
  // SQLITE_ERROR: a table is there, but has other columns.
  if (IsDamage(error) || error.getErrorCode() == SQLITE_ERROR) {
    throw InputError(fmt::format("{}: is damaged: {}", path, error.what()));
  }
  throw OutputError(fmt::format("{}: cannot be opened: {}", path, error.what()));
}

void ThrowFailed(const std::string& path, const char* doing, const SQLite::Exception& error) {
  throw OutputError(fmt::format("{}: {}: {}", path, doing, error.what()));
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
    // A row tells whether somebody was in the way.
    database_->execAndGet("PRAGMA wal_checkpoint(RESTART)");
  } catch (...) {
    database_->setBusyTimeout(timeout_ms);
    throw;
  }
  database_->setBusyTimeout(timeout_ms);
}

}  // namespace lamina
