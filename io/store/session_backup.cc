#include "io/store/session_backup.h"

#include <SQLiteCpp/SQLiteCpp.h>

#include <filesystem>
#include <utility>

#include "core/base/error.h"
#include "io/file/disk_room.h"
#include "io/file/sqlite_file.h"
#include "io/store/session_database.h"
#include "io/store/session_rows.h"

namespace lamina {
namespace {

std::string JournalOf(const std::string& copy) { return copy + "-journal"; }

}  // namespace

SessionBackup::SessionBackup(std::string database, std::string copy)
    : database_(std::move(database)), copy_(std::move(copy)) {}

std::int64_t SessionBackup::Update(std::uint64_t room_left) {
  const SessionDatabase database(database_, false);
  const std::int64_t scans = database.scans();
  if (current_) {
    RequireRoom(copy_, room_left);  // if there is none, the copy is as it was
    current_ = false;
    Add();
  } else {
    try {
      RollBack(copy_);
    } catch (const InputError&) {
      // It is of no use, and its journal must not be taken for that of the copy in its place.
      std::filesystem::remove(JournalOf(copy_));
    }
    database.BackUpTo(copy_, room_left);
  }
  current_ = true;
  return scans;
}

void SessionBackup::Add() const {
  OnSqlite(copy_, "cannot be written", [&] {
    SQLite::Database copy(copy_, SQLite::OPEN_READWRITE);
    SQLite::Statement attach(copy, "ATTACH ? AS session");
    attach.bind(1, database_);
    attach.exec();
    SQLite::Transaction transaction(copy);
    // Scans become final in their order. One that was open may have become so since.
    SQLite::Statement last(copy,
                           "SELECT scan FROM main.scans WHERE final ORDER BY scan DESC LIMIT 1");
    const std::int64_t from = last.executeStep() ? last.getColumn(0).getInt64() + 1 : 0;
    last.reset();
    for (const char* statement : kAddToCopy) {
      SQLite::Statement add(copy, statement);
      if (add.getBindParameterCount() > 0) add.bind(1, from);
      add.exec();
    }
    transaction.commit();
  });
}

void SessionBackup::RollBack(const std::string& copy) {
  if (!std::filesystem::exists(JournalOf(copy))) return;
  OpenSqlite(copy, [&] {
    SQLite::Database(copy, SQLite::OPEN_READWRITE).execAndGet("SELECT COUNT(*) FROM sqlite_master");
  });
  // What is left of it now was not begun in earnest.
  std::filesystem::remove(JournalOf(copy));
}

std::int64_t SessionBackup::Scans(const std::string& copy) {
  try {
    RollBack(copy);
    const SQLite::Database backup = OpenUntouched(copy);
    SQLite::Statement scans(backup, kCountScans);
    scans.executeStep();
    return scans.getColumn(0).getInt64();
  } catch (const SQLite::Exception&) {
    return 0;
  } catch (const InputError&) {
    return 0;
  }
}

}  // namespace lamina
