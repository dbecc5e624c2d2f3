// Bytes that outgrow memory, for as long as a file is made: in a file without a name, in the folder
// of what is made of them. It is gone with the process.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace lamina {

// Not thread-safe. All members throw OutputError, naming the file that is made; of a full disk it
// is a DiskFullError (io/file/disk_room.h).
class SpoolFile {
 public:
  // `path` is what is made.
  explicit SpoolFile(const std::string& path);
  ~SpoolFile();
  SpoolFile(const SpoolFile&) = delete;
  SpoolFile& operator=(const SpoolFile&) = delete;

  std::uint64_t size() const { return size_; }
  void Append(std::string_view bytes);
  // Replaces bytes that are there.
  void Overwrite(std::uint64_t at, std::string_view bytes);
  // Exactly so many, which must be there.
  std::string Read(std::uint64_t at, std::size_t bytes) const;

 private:
  const std::string path_;
  int file_ = -1;
  std::uint64_t size_ = 0;
};

}  // namespace lamina
