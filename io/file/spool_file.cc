#include "io/file/spool_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>

#include "io/file/disk_room.h"

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
  while (!bytes.empty()) {
    const ssize_t put = pwrite(file_, bytes.data(), bytes.size(), static_cast<off_t>(at));
    if (put < 0 && errno == EINTR) continue;
    if (put <= 0) ThrowNotWritten(path_, "its points cannot be kept", put < 0 ? errno : ENOSPC);
    bytes.remove_prefix(static_cast<std::size_t>(put));
    at += static_cast<std::uint64_t>(put);
  }
}

std::string SpoolFile::Read(std::uint64_t at, std::size_t bytes) const {
  std::string result(bytes, '\0');
  std::size_t got = 0;
  while (got < bytes) {
    const ssize_t more =
        pread(file_, result.data() + got, bytes - got, static_cast<off_t>(at + got));
    if (more < 0 && errno == EINTR) continue;
    if (more <= 0)
      ThrowNotWritten(path_, "its points cannot be read again", more < 0 ? errno : EIO);
    got += static_cast<std::size_t>(more);
  }
  return result;
}

}  // namespace lamina
