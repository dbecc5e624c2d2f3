// The folder of a session: its lock, its database and its tiles, and what is done where they are
// damaged.
#pragma once

#include <memory>
#include <string>

#include "io/store/byte_file.h"
#include "io/store/session_database.h"
#include "io/store/tile_store.h"

namespace lamina {

// Holds the folder for this process until it is destroyed; the lock goes with the process, however
// that ends.
class SessionFolder {
 public:
  // Makes the folder if it is not there, and removes what a process that was killed has left of
  // files that were to be whole. Throws InputError if another process works on the session or is
  // copying its map; OutputError.
  explicit SessionFolder(std::string path);
  ~SessionFolder();
  SessionFolder(const SessionFolder&) = delete;
  SessionFolder& operator=(const SessionFolder&) = delete;

  const std::string& path() const { return path_; }
  // Of a file in it.
  std::string Path(const std::string& name) const;

  // The database; where it is damaged, its copy of the last checkpoint that has one. What was
  // damaged stays beside it. Throws InputError if neither can be used.
  std::unique_ptr<SessionDatabase> OpenDatabase() const;
  // The tiles; where they are damaged, none.
  std::unique_ptr<TileStore> OpenTiles() const;
  // What its submaps hold. Throws OutputError.
  std::unique_ptr<ByteFile> OpenSubmaps() const;

 private:
  std::string path_;
  int lock_ = -1;
};

// What leaves the memory of a session's mapping.
struct SessionStores {
  TileStore* tiles = nullptr;
  ByteFile* submaps = nullptr;  // null without loops
};

// In a session's folder, the file of OpenSubmaps().
inline constexpr const char* kSubmapLeavesName = "submap_leaves.bin";

// Keeps a session as it is while its map is read: no process can begin to work on it.
class SessionReadingLock {
 public:
  // Throws InputError if a process works on it.
  explicit SessionReadingLock(const std::string& session);
  ~SessionReadingLock();
  SessionReadingLock(const SessionReadingLock&) = delete;
  SessionReadingLock& operator=(const SessionReadingLock&) = delete;

 private:
  int file_;
};

// In the database: the options that decide results.
inline constexpr const char* kFixedOptions = "fixed_options";

}  // namespace lamina
