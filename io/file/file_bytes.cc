#include "io/file/file_bytes.h"

#include <unistd.h>

#include <cerrno>

namespace lamina {

bool WriteAt(int file, std::uint64_t at, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t put = pwrite(file, bytes.data(), bytes.size(), static_cast<off_t>(at));
    if (put < 0 && errno == EINTR) continue;
    if (put == 0) errno = ENOSPC;
    if (put <= 0) return false;
    bytes.remove_prefix(static_cast<std::size_t>(put));
    at += static_cast<std::uint64_t>(put);
  }
  return true;
}

std::optional<std::size_t> ReadAt(int file, std::uint64_t at, char* to, std::size_t bytes) {
  std::size_t done = 0;
  while (done < bytes) {
    const ssize_t more = pread(file, to + done, bytes - done, static_cast<off_t>(at + done));
    if (more < 0 && errno == EINTR) continue;
    if (more < 0) return std::nullopt;
    if (more == 0) break;
    done += static_cast<std::size_t>(more);
  }
  return done;
}

}  // namespace lamina
