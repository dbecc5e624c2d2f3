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

}  // namespace lamina
