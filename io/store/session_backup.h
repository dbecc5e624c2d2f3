// The copy of a session's database, in case that is damaged: kept up to date while the session goes
// on, at the cost of what has come since the last time.
#pragma once

#include <cstdint>
#include <string>

namespace lamina {

// Not thread-safe; other connections may write to the database meanwhile.
class SessionBackup {
 public:
  SessionBackup(std::string database, std::string copy);

  // Makes the copy that of a moment not before now, and returns how many scans are in it. Where
  // that would leave less than `room_left` bytes on the disk, it is a DiskFullError
  // (io/file/disk_room.h) before anything is written. The first time the whole is copied, so that
  // no damage of an earlier copy stays (BackUpTo); after that, rows are added in one transaction.
  // Throws OutputError; the copy is then as it was, or RollBack() makes it so, and the next time
  // the whole is copied.
  std::int64_t Update(std::uint64_t room_left = 0);

  // Undoes what a process that was ended had begun to change in a copy. Before the copy is read,
  // but by Update(). Throws InputError if it is damaged.
  static void RollBack(const std::string& copy);
  // How many scans are in a copy, in which nothing changes but that an addition that was
  // interrupted is undone; 0 if there is none that can be read.
  static std::int64_t Scans(const std::string& copy);

 private:
  void Add() const;

  std::string database_, copy_;
  bool current_ = false;  // the copy lacks only what has come since
};

}  // namespace lamina
