#include "io/recording/scan_layout.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "core/base/error.h"
#include "io/points/scan_file.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

ScanLayout Odometry(const fs::path& root, const fs::path& scans) {
  return {scans, root / "times.txt", root / "calib.txt", false, ""};
}

ScanLayout Raw(const fs::path& root, const fs::path& scans) {
  return {scans, root / "timestamps.txt", "", true, ""};
}

// What is written for all scans of the folder tells nothing of a single one; its name may.
ScanLayout LayoutOfFile(const fs::path& path) {
  if (!IsScanFile(path.string())) {
    throw InputError(fmt::format(
        "{}: is no folder that holds scans, no scan by its name ({}), and no ROS 1 bag, MCAP file, "
        "ROS 2 bag or capture of packets",
        path.string(), ScanEndings()));
  }
  return {path.parent_path(), "", "", false, path};
}

}  // namespace

bool MayExist(const fs::path& path) {
  std::error_code ignored;
  return !path.empty() && fs::status(path, ignored).type() != fs::file_type::not_found;
}

ScanLayout FindScanLayout(const fs::path& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) {
    throw InputError(fmt::format("{}: cannot be read: {}", path.string(), error.message()));
  }
  if (!fs::is_directory(status)) return LayoutOfFile(path);
  // Through the absolute path, so that `.` and a trailing slash do not hide the folder's name.
  const fs::path folder = fs::weakly_canonical(path, error);
  if (fs::is_directory(path / "velodyne", error)) return Odometry(path, path / "velodyne");
  if (folder.filename() == "velodyne") return LayoutOfFolder(path);
  if (fs::is_directory(path / "velodyne_points" / "data", error)) {
    return Raw(path / "velodyne_points", path / "velodyne_points" / "data");
  }
  if (folder.filename() == "velodyne_points") return Raw(path, path / "data");
  return LayoutOfFolder(path);
}

std::vector<FolderOfScans> FoldersBelow(const fs::path& folder) {
  constexpr std::size_t kMost = 5;
  constexpr int kDepth = 2;
  std::vector<FolderOfScans> found;
  std::vector<fs::path> level{folder};
  for (int depth = 0; depth < kDepth && found.empty(); ++depth) {
    std::vector<fs::path> next;
    for (const fs::path& above : level) {
      std::error_code ignored;
      for (const auto& entry : fs::directory_iterator(above, ignored)) {
        if (entry.is_directory(ignored)) next.push_back(entry.path());
      }
    }
    std::sort(next.begin(), next.end());
    for (const fs::path& below : next) {
      if (found.size() == kMost) break;
      try {
        const std::size_t scans = ListScans(below, ScanName::kPoints).size();
        if (scans > 0) found.push_back({below, scans});
      } catch (const InputError&) {
        // Not to be read, so not to be named.
      }
    }
    level = std::move(next);
  }
  return found;
}

ScanLayout LayoutOfFolder(const fs::path& folder) {
  std::error_code error;
  const fs::path absolute = fs::weakly_canonical(folder, error);
  const fs::path up = absolute.parent_path();
  if (absolute.filename() == "velodyne") return Odometry(up, folder);
  if (absolute.filename() == "data" && up.filename() == "velodyne_points") return Raw(up, folder);
  const char* name = MayExist(folder / "times.txt") ? "times.txt" : "timestamps.txt";
  return {folder, folder / name, "", false, ""};
}

}  // namespace lamina
