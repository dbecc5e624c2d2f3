// A file that is whole or not there: written under a temporary name, flushed to disk, renamed by
// Commit().
#pragma once

#include <cstdio>
#include <string>
#include <string_view>

namespace lamina {

// Not thread-safe. A writer destroyed without Commit() removes its temporary file.
class FileWriter {
 public:
  // Throws OutputError if the file cannot be created.
  explicit FileWriter(std::string path);
  ~FileWriter();
  FileWriter(const FileWriter&) = delete;
  FileWriter& operator=(const FileWriter&) = delete;

  // Throw OutputError (disk full, ...), naming the path and the system's reason.
  void Write(std::string_view bytes);
  void Commit();

 private:
  std::string path_;
  std::string temporary_path_;
  std::FILE* file_ = nullptr;
};

}  // namespace lamina
