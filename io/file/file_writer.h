// A file that is whole or not there: written under a temporary name beside the target, flushed to
// disk, renamed by Commit(), and the new name flushed, too. Whatever goes wrong before leaves an
// older file of that name as it was.
//
// A rename is on disk when its *folder* is: until then a power cut may undo it, though it happened
// after something that was flushed later.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>

namespace lamina {

// Makes a folder, and those above it. On return the names of those that were made are on disk.
// Throws OutputError.
void MakeDirectory(const std::string& path);

// Flushes the names in a folder: those that were made, renamed or removed. Throws OutputError.
void SyncFolder(const std::string& folder);

// A copy of the bytes of `from`, whole and on disk when this returns; else `to` is as it was
// before. Throws InputError if `from` cannot be read, OutputError if `to` cannot be written.
void CopyFile(const std::string& from, const std::string& to);

// Not thread-safe, and two writers must not have the same path at the same time (the temporary name
// is `path + ".partial"`). A writer destroyed without Commit() removes its temporary file.
class FileWriter {
 public:
  // Throws OutputError if the file cannot be created, or if `path` is there already and is not a
  // regular file (a rename would do away with a device such as /dev/null).
  explicit FileWriter(std::string path);
  ~FileWriter();
  FileWriter(const FileWriter&) = delete;
  FileWriter& operator=(const FileWriter&) = delete;

  // Throw OutputError, naming the path and the system's reason; for a full disk it is a
  // DiskFullError (io/file/disk_room.h). Bytes are buffered: that may show as late as in Commit().
  void Write(std::string_view bytes);
  // Replaces bytes that have been written before, e.g. a header's count; Write() goes on at the
  // end.
  void Overwrite(std::uint64_t offset, std::string_view bytes);
  void Commit();

 private:
  [[noreturn]] void Fail(const char* doing) const;

  std::string path_;
  std::string temporary_path_;
  std::FILE* file_ = nullptr;
  bool temporary_exists_ = false;
};

}  // namespace lamina
