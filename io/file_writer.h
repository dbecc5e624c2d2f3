// A file that is whole or not there: written under a temporary name beside the target, flushed to
// disk, renamed by Commit(). Whatever goes wrong before leaves an older file of that name as it
// was.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>

namespace lamina {

// Makes a folder, and those above it. Throws OutputError.
void MakeDirectory(const std::string& path);

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

  // Throw OutputError (disk full, ...), naming the path and the system's reason. Bytes are
  // buffered: a full disk may show as late as in Commit().
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
