#include "io/file/published_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <optional>
#include <utility>
#include <vector>

#include "io/file/disk_room.h"
#include "io/file/file_bytes.h"

namespace lamina {
namespace {

// Whether all was done; errno tells why not.
bool CopyRange(int from, int to, std::uint64_t begin, std::uint64_t end) {
  std::vector<char> block(std::min<std::uint64_t>(end - begin, 1 << 20));
  while (begin < end) {
    const std::size_t bytes = std::min<std::uint64_t>(end - begin, block.size());
    const std::optional<std::size_t> read = ReadAt(from, begin, block.data(), bytes);
    if (!read) return false;
    if (*read < bytes) {  // another process has cut it
      errno = EIO;
      return false;
    }
    if (!WriteAt(to, begin, {block.data(), bytes})) return false;
    begin += bytes;
  }
  return true;
}

// Whether an open file has that name.
bool IsAt(int file, const std::string& path) {
  struct stat is = {}, there = {};
  return fstat(file, &is) == 0 && stat(path.c_str(), &there) == 0 && is.st_ino == there.st_ino &&
         is.st_dev == there.st_dev;
}

}  // namespace

PublishedFile::PublishedFile(std::string path)
    : path_(std::move(path)), next_path_(path_ + ".partial") {}

PublishedFile::~PublishedFile() {
  DropNext();
  if (shown_.file >= 0) close(shown_.file);
}

void PublishedFile::Append(std::string_view bytes) {
  PrepareNext();
  if (!WriteAt(next_.file, next_.stays, bytes)) Fail("cannot be written");
  next_.stays += bytes.size();
}

void PublishedFile::Publish(std::string_view tail) {
  PrepareNext();
  if (!WriteAt(next_.file, next_.stays, tail) ||
      ftruncate(next_.file, static_cast<off_t>(next_.stays + tail.size())) != 0 ||
      fdatasync(next_.file) != 0) {
    Fail("cannot be written");
  }
  Show();
}

// Brings the next copy up to where the one that is shown stands, at least.
void PublishedFile::PrepareNext() {
  if (next_.file < 0) {
    next_.file = open(next_path_.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (next_.file < 0) Fail("cannot be created");
    next_.stays = 0;
  }
  if (next_.stays >= shown_.stays) return;
  if (!CopyRange(shown_.file, next_.file, next_.stays, shown_.stays)) Fail("cannot be written");
  next_.stays = shown_.stays;
}

void PublishedFile::Show() {
  // The first time, and on file systems that cannot exchange names, the next copy is made anew.
  const bool exchanged = shown_.file >= 0 && renameat2(AT_FDCWD, next_path_.c_str(), AT_FDCWD,
                                                       path_.c_str(), RENAME_EXCHANGE) == 0;
  if (!exchanged && std::rename(next_path_.c_str(), path_.c_str()) != 0) {
    Fail("cannot be renamed to");
  }
  std::swap(shown_, next_);
  if (next_.file < 0) return;
  if (!exchanged) {
    close(std::exchange(next_, {}).file);
  } else if (!IsAt(next_.file, next_path_)) {
    DropNext();  // another process has put a file there, which now has the name of the next copy
  }
}

void PublishedFile::DropNext() {
  if (next_.file < 0) return;
  std::remove(next_path_.c_str());
  close(std::exchange(next_, {}).file);
}

void PublishedFile::Fail(const char* doing) const { ThrowNotWritten(path_, doing, errno); }

}  // namespace lamina
