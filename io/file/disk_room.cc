#include "io/file/disk_room.h"

#include <fmt/format.h>
#include <sys/statvfs.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

namespace lamina {

std::uint64_t FreeBytes(const std::string& path) {
  struct statvfs status = {};
  if (statvfs(path.c_str(), &status) != 0) {
    throw OutputError(fmt::format("{}: the room on its disk cannot be found out: {}", path,
                                  std::strerror(errno)));
  }
  return static_cast<std::uint64_t>(status.f_bavail) * status.f_frsize;
}

void RequireRoom(const std::string& path, std::uint64_t needed) {
  const std::uint64_t free = FreeBytes(std::filesystem::absolute(path).parent_path().string());
  if (free >= needed) return;
  throw DiskFullError(
      fmt::format("{}: is not written: {} bytes are needed, {} are free", path, needed, free));
}

void ThrowNotWritten(const std::string& path, const char* doing, int error) {
  const std::string text = fmt::format("{}: {}: {}", path, doing, std::strerror(error));
  if (error == ENOSPC || error == EDQUOT) throw DiskFullError(text);
  throw OutputError(text);
}

}  // namespace lamina
