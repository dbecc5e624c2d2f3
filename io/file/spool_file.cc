#include "io/file/spool_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <optional>

#include "io/file/disk_room.h"
#include "io/file/file_bytes.h"

namespace lamina {

SpoolFile::SpoolFile(const std::string& path) : path_(path) {
  const std::string name = path_ + ".points";
  constexpr mode_t kOwnerOnly = 0600;
  file_ = open(name.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, kOwnerOnly);
  if (file_ < 0) ThrowNotWritten(name, "cannot be created", errno);
  unlink(name.c_str());
}

SpoolFile::~SpoolFile() { close(file_); }

void SpoolFile::Append(std::string_view bytes) {
  Overwrite(size_, bytes);
  size_ += bytes.size();
}

void SpoolFile::Overwrite(std::uint64_t at, std::string_view bytes) {
  if (!WriteAt(file_, at, bytes)) ThrowNotWritten(path_, "its points cannot be kept", errno);
}

std::string SpoolFile::Read(std::uint64_t at, std::size_t bytes) const {
  std::string result(bytes, '\0');
  const std::optional<std::size_t> got = ReadAt(file_, at, result.data(), bytes);
  if (got != bytes) ThrowNotWritten(path_, "its points cannot be read again", got ? EIO : errno);
  return result;
}

}  // namespace lamina
