#include "io/inbox/file_arrival.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>

#include "core/base/error.h"
#include "io/points/scan_file.h"
#include "io/recording/recording_file.h"

namespace lamina {
namespace {

FileLook Refused(std::string reason) {
  FileLook look;
  look.what = FileLook::What::kRefused;
  look.reason = std::move(reason);
  return look;
}

FileLook FromStatus(const struct stat& status) {
  FileLook look;
  if (S_ISDIR(status.st_mode)) {
    look.what = FileLook::What::kFolder;
    return look;
  }
  if (!S_ISREG(status.st_mode)) return Refused("is not a regular file");
  look.what = FileLook::What::kFile;
  look.size = static_cast<std::uint64_t>(status.st_size);
  look.modified_ns = std::int64_t{status.st_mtim.tv_sec} * 1'000'000'000 + status.st_mtim.tv_nsec;
  look.linked = status.st_nlink > 1;
  return look;
}

FileLook LookThroughLink(const std::string& root, const std::string& path) {
  struct Free {
    void operator()(char* text) const { std::free(text); }
  };
  const std::unique_ptr<char, Free> resolved(realpath(path.c_str(), nullptr));
  if (resolved == nullptr && errno == ENOENT) {
    FileLook look;
    look.what = FileLook::What::kDangling;
    look.linked = true;
    return look;
  }
  if (resolved == nullptr) {
    return Refused(fmt::format("is a symbolic link that leads nowhere: {}", std::strerror(errno)));
  }
  const std::string target = resolved.get();
  const std::string inside = root == "/" ? root : root + "/";
  if (target != root && target.compare(0, inside.size(), inside) != 0) {
    return Refused(fmt::format("is a symbolic link out of the inbox, to {}", target));
  }
  struct stat status;
  if (stat(target.c_str(), &status) != 0) return FileLook();
  FileLook look = FromStatus(status);
  look.linked = true;
  return look;
}

// As long as files that belong to it grow, it does.
void AddParts(const std::string& path, FileLook* look) {
  try {
    for (const std::string& part : FilesOfRecording(path)) {
      struct stat status;
      if (part == path || stat(part.c_str(), &status) != 0) continue;
      const FileLook of_part = FromStatus(status);
      look->size += of_part.size;
      look->modified_ns = std::max(look->modified_ns, of_part.modified_ns);
    }
  } catch (const InputError&) {
    // Opening it tells.
  }
}

}  // namespace

FileLook LookAtFile(const std::string& root, const std::string& name) {
  const std::string path = root + "/" + name;
  struct stat status;
  if (lstat(path.c_str(), &status) != 0) {
    if (errno == ENOENT || errno == ENOTDIR) return FileLook();
    return Refused(fmt::format("cannot be looked at: {}", std::strerror(errno)));
  }
  FileLook look = S_ISLNK(status.st_mode) ? LookThroughLink(root, path) : FromStatus(status);
  if (look.what == FileLook::What::kFile &&
      IsRecordingFile(std::filesystem::path(name).filename().string())) {
    AddParts(path, &look);
  }
  return look;
}

bool IsWhole(const std::string& path, std::uint64_t size) {
  if (size == 0) return false;
  const std::string name = std::filesystem::path(path).filename().string();
  return IsRecordingFile(name) ? IsWholeRecording(path) : IsWholeScanFile(path, size);
}

}  // namespace lamina
