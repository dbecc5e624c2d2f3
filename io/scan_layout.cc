#include "io/scan_layout.h"

#include <fmt/format.h>

#include "core/error.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

ScanLayout Odometry(const fs::path& root, const fs::path& scans) {
  return {scans, root / "times.txt", root / "calib.txt", false};
}

ScanLayout Raw(const fs::path& root, const fs::path& scans) {
  return {scans, root / "timestamps.txt", "", true};
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
  if (!fs::is_directory(status)) {
    throw InputError(
        fmt::format("{}: is not a folder; scans are given by the folder that holds "
                    "them",
                    path.string()));
  }
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

ScanLayout LayoutOfFolder(const fs::path& folder) {
  std::error_code error;
  const fs::path absolute = fs::weakly_canonical(folder, error);
  const fs::path up = absolute.parent_path();
  if (absolute.filename() == "velodyne") return Odometry(up, folder);
  if (absolute.filename() == "data" && up.filename() == "velodyne_points") return Raw(up, folder);
  const char* name = MayExist(folder / "times.txt") ? "times.txt" : "timestamps.txt";
  return {folder, folder / name, "", false};
}

}  // namespace lamina
