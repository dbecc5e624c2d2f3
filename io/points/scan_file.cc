#include "io/points/scan_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <iterator>
#include <optional>

#include "core/base/error.h"
#include "io/file/file_bytes.h"
#include "io/file/folder_list.h"
#include "io/points/ethz_csv.h"
#include "io/points/kitti_scan.h"
#include "io/points/las_scan.h"
#include "io/points/point_cloud_files.h"
#include "io/points/point_file_check.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

struct PointFormat {
  const char* ending;  // in lower case
  ScanName in_folders;
  Scan (*read)(const std::string& path, PointTimeUnit unit, PointTimeField* times);
  // How long a file must be by its first bytes, see point_file_check.h; null if they do not tell.
  std::optional<std::size_t> (*declared_bytes)(std::string_view head);
  // Whether a whole file may be so long; null if any may.
  bool (*whole)(std::size_t bytes);
};

// A new format is a file with its reader, and a row here.
constexpr PointFormat kFormats[] = {
    {".bin", ScanName::kPoints, ReadKittiBin, nullptr, IsWholeKittiBin},
    {".pcd", ScanName::kPoints, ReadPcd, DeclaredPcdBytes, nullptr},
    {".ply", ScanName::kPoints, ReadPly, DeclaredPlyBytes, nullptr},
    {".las", ScanName::kPoints, ReadLas, DeclaredLasBytes, nullptr},
    {".laz", ScanName::kPoints, ReadLas, DeclaredLasBytes, nullptr},
    {".csv", ScanName::kNone, ReadHokuyoCsv, nullptr, nullptr},
    {".txt", ScanName::kText, ReadKittiText, nullptr, nullptr},
};

// Null if there is none.
const PointFormat* FormatOf(std::string_view path) {
  const std::string ending = LowerEnding(path);
  for (const PointFormat& format : kFormats) {
    if (ending == format.ending) return &format;
  }
  return nullptr;
}

// The first bytes of a file, `most` if it has as many; nothing if it cannot be read.
std::optional<std::string> HeadOf(int file, std::size_t most) {
  std::string head(most, '\0');
  const std::optional<std::size_t> got = ReadAt(file, 0, head.data(), most);
  if (!got) return std::nullopt;
  head.resize(*got);
  return head;
}

}  // namespace

ScanName KindOfName(std::string_view name) {
  if (name.empty() || name[0] == '.') return ScanName::kNone;
  const PointFormat* const format = FormatOf(name);
  return format == nullptr ? ScanName::kNone : format->in_folders;
}

std::vector<fs::path> ListScans(const fs::path& folder, ScanName kind) {
  return ListFiles(folder, [kind](const std::string& name) { return KindOfName(name) == kind; });
}

bool IsScanFile(const std::string& path) {
  const std::string name = fs::path(path).filename().string();
  return !name.empty() && name[0] != '.' && FormatOf(name) != nullptr;
}

std::string ScanEndings() {
  std::string text;
  for (const PointFormat& format : kFormats) {
    const bool last = &format == std::end(kFormats) - 1;
    text += fmt::format("{}{}", text.empty() ? "" : last ? " or " : ", ", format.ending);
  }
  return text;
}

std::string FolderPatterns() {
  std::string text;
  for (const PointFormat& format : kFormats) {
    if (format.in_folders != ScanName::kPoints) continue;
    text += fmt::format("{}*{}", text.empty() ? "" : ", ", format.ending);
  }
  return text;
}

Scan ReadScanFile(const std::string& path, PointTimeUnit unit, PointTimeField* times) {
  if (times != nullptr) *times = {};
  const PointFormat* const format = FormatOf(path);
  if (format == nullptr) {
    throw InputError(fmt::format("{}: a point file ends in {}", path, ScanEndings()));
  }
  return format->read(path, unit, times);
}

bool IsWholeScanFile(const std::string& path, std::uint64_t size) {
  const PointFormat* const format = FormatOf(path);
  if (format == nullptr) return true;
  if (format->whole != nullptr && !format->whole(size)) return false;
  if (format->declared_bytes == nullptr) return true;
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (file < 0) return true;
  // Headers have some hundred bytes; only one full of comments takes more than the first read.
  constexpr std::size_t kMostBytes = std::size_t{1} << 18;
  std::optional<std::size_t> declared;
  std::optional<std::string> head;
  for (const std::size_t most : {std::size_t{1} << 12, kMostBytes}) {
    head = HeadOf(file, most);
    if (!head) break;
    declared = format->declared_bytes(*head);
    if (declared || head->size() < most) break;
  }
  close(file);
  if (!head) return true;
  return declared ? size >= *declared : head->size() == kMostBytes;
}

}  // namespace lamina
