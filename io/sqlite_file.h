// What the files of SQLite's here have in common.
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <string>

namespace lamina {

// Whether SQLite found its file to be damaged, or to be something else altogether.
bool IsDamage(const SQLite::Exception& error);

[[noreturn]] void ThrowNotOpened(const std::string& path, const SQLite::Exception& error);
[[noreturn]] void ThrowFailed(const std::string& path, const char* doing,
                              const SQLite::Exception& error);

// Runs `open`, which opens the file. Throws InputError if it is damaged, OutputError if it cannot
// be opened otherwise; both name it.
template <typename Open>
void OpenSqlite(const std::string& path, const Open& open) {
  try {
    open();
  } catch (const SQLite::Exception& error) {
    ThrowNotOpened(path, error);
  }
}

// Runs `work` on an open file and returns what it does. Throws OutputError, naming the file and
// what was being done ("cannot be read").
template <typename Work>
auto OnSqlite(const std::string& path, const char* doing, const Work& work) {
  try {
    return work();
  } catch (const SQLite::Exception& error) {
    ThrowFailed(path, doing, error);
  }
}

// Brings the write-ahead log into the file, as far as nobody needs it.
void BringLogIntoFile(SQLite::Database* database);

}  // namespace lamina
