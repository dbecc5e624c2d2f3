// What the files of SQLite's here have in common.
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <cstddef>
#include <string>

namespace lamina {

// Whether SQLite found its file to be damaged, or to be something else altogether.
bool IsDamage(const SQLite::Exception& error);

[[noreturn]] void ThrowNotOpened(const std::string& path, const SQLite::Exception& error);
[[noreturn]] void ThrowFailed(const std::string& path, const char* doing,
                              const SQLite::Exception& error);

// Runs `open`, which opens the file. Throws InputError if it is damaged, OutputError if it cannot
// be opened otherwise (DiskFullError: there is no room for what opening writes); all name it.
template <typename Open>
void OpenSqlite(const std::string& path, const Open& open) {
  try {
    open();
  } catch (const SQLite::Exception& error) {
    ThrowNotOpened(path, error);
  }
}

// Runs `work` on an open file and returns what it does. Throws OutputError (DiskFullError for a
// full disk), naming the file and what was being done ("cannot be read").
template <typename Work>
auto OnSqlite(const std::string& path, const char* doing, const Work& work) {
  try {
    return work();
  } catch (const SQLite::Exception& error) {
    ThrowFailed(path, doing, error);
  }
}

// Opens a database to be read without a trace. SQLite makes a log and an index of it beside each
// file that it opens, unless told that no process writes; which holds for a file without a log.
SQLite::Database OpenUntouched(const std::string& path);
// The name by which ATTACH does so.
std::string UntouchedUri(const std::string& path);

// Brings the write-ahead log into the file, as far as no reader needs it. The log begins anew only
// if no process writes while it does: under a writer that never pauses it grows on. See LogLimit.
void BringLogIntoFile(SQLite::Database* database);

// Bounds the write-ahead log that the only writer of a database makes. Not thread-safe: for the
// thread that writes.
class LogLimit {
 public:
  // Of an open database, which must not outlive this.
  LogLimit(SQLite::Database* database, std::size_t most_bytes);
  LogLimit(const LogLimit&) = delete;
  LogLimit& operator=(const LogLimit&) = delete;

  // To be called between two transactions. If the log has become longer than allowed, brings it
  // into the file, after which it begins anew. Waits for no reader: if one still needs the log,
  // this is tried again when an eighth more has been written. Throws SQLite::Exception.
  void Keep();

 private:
  SQLite::Database* database_;
  std::size_t most_bytes_;
  std::size_t page_bytes_;
  std::size_t log_bytes_ = 0;  // after the last commit
  std::size_t limit_bytes_;    // at which it is tried next
};

}  // namespace lamina
