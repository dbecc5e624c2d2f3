#include "backend/session/folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>

#include "core/base/error.h"
#include "io/file/file_writer.h"
#include "io/store/session_backup.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

void MoveAwayDamaged(const std::string& database) {
  for (const char* ending : {"", "-wal", "-shm"}) {
    std::error_code ignored;
    fs::rename(database + ending, database + ".damaged" + ending, ignored);
  }
}

// What a process that was killed has left of files that were to be whole.
void RemovePartialFiles(const std::string& folder) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string ending = entry.path().extension().string();
    std::error_code ignored;
    if (ending == ".partial" || ending == ".partial-journal") fs::remove(entry.path(), ignored);
  }
}

std::string OwnerOf(int lock) {
  char owner[32] = {};
  const ssize_t length = pread(lock, owner, sizeof(owner) - 1, 0);
  return length > 0 ? owner : "?";
}

// Returns the descriptor of the lock, which holds this process's number.
int LockFolder(const std::string& folder) {
  const std::string path = (fs::path(folder) / "lock").string();
  const int lock = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (lock < 0) throw OutputError(fmt::format("{}: {}", path, std::strerror(errno)));
  if (flock(lock, LOCK_EX | LOCK_NB) != 0) {
    const bool is_read = flock(lock, LOCK_SH | LOCK_NB) == 0;
    const std::string owner = OwnerOf(lock);
    close(lock);
    if (is_read) {
      throw InputError(fmt::format(
          "{}: another session is copying the map of this one, to localise in it; start again when "
          "it has",
          folder));
    }
    throw InputError(fmt::format("{}: the session is in use by process {}", folder, owner));
  }
  const std::string pid = std::to_string(getpid());
  if (ftruncate(lock, 0) != 0 || write(lock, pid.data(), pid.size()) < 0) {
    const std::string reason = std::strerror(errno);
    close(lock);
    throw OutputError(fmt::format("{}: cannot be written: {}", path, reason));
  }
  return lock;
}

}  // namespace

SessionFolder::SessionFolder(std::string path) : path_(std::move(path)) {
  MakeDirectory(path_);
  lock_ = LockFolder(path_);
  RemovePartialFiles(path_);
}

SessionFolder::~SessionFolder() { close(lock_); }

std::string SessionFolder::Path(const std::string& name) const {
  return (fs::path(path_) / name).string();
}

std::unique_ptr<SessionDatabase> SessionFolder::OpenDatabase() const {
  const std::string path = Path("session.db"), backup = Path("session.db.backup");
  try {
    auto database = std::make_unique<SessionDatabase>(path, true);
    // A file that is gone or cut to nothing makes a new database.
    if (database->Meta(kFixedOptions) || !fs::exists(backup)) return database;
    spdlog::error("{}: has lost all that was in it; going back to the copy of the last checkpoint",
                  path);
  } catch (const OtherFormatError&) {
    throw;
  } catch (const InputError& error) {
    if (!fs::exists(backup)) throw;
    spdlog::error("{}; going back to the copy of the last checkpoint", error.what());
  }
  MoveAwayDamaged(path);
  SessionBackup::RollBack(backup);
  CopyFile(backup, path);
  return std::make_unique<SessionDatabase>(path, true);
}

std::unique_ptr<TileStore> SessionFolder::OpenTiles() const {
  const std::string path = Path("map_tiles.db");
  try {
    return std::make_unique<TileStore>(path, TileStore::Lifetime::kKept);
  } catch (const InputError& error) {
    spdlog::error("{}; the places it held are mapped anew when the sensor comes back to them",
                  error.what());
    MoveAwayDamaged(path);
    return std::make_unique<TileStore>(path, TileStore::Lifetime::kKept);
  }
}

std::unique_ptr<ByteFile> SessionFolder::OpenSubmaps() const {
  return std::make_unique<ByteFile>(Path(kSubmapLeavesName), ByteFile::Lifetime::kKept);
}

SessionReadingLock::SessionReadingLock(const std::string& session)
    : file_(open((fs::path(session) / "lock").c_str(), O_RDONLY | O_CLOEXEC)) {
  // Without the file no process has ever worked on it.
  if (file_ < 0 || flock(file_, LOCK_SH | LOCK_NB) == 0) return;
  const std::string owner = OwnerOf(file_);
  close(file_);
  throw InputError(
      fmt::format("{}: the session is in use by process {}: to localise in its map, end that first",
                  session, owner));
}

SessionReadingLock::~SessionReadingLock() {
  if (file_ >= 0) close(file_);
}

}  // namespace lamina
