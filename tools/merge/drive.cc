#include "tools/merge/drive.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <tuple>
#include <utility>

#include "core/base/error.h"
#include "io/file/checksum.h"
#include "io/map/trajectory_io.h"
#include "tools/results/piece_poses.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// What tells the age of a frame.
using Age = std::tuple<StampNs, std::size_t, std::uint32_t>;

Age AgeOf(const SubmapFrame& frame) {
  if (frame.submaps.empty()) return {0, 0, 0};
  const Submap& first = frame.submaps.front();
  const auto* bytes = reinterpret_cast<const char*>(first.leaves.data());
  return {first.keyframes.front().stamp_ns, frame.submaps.size(),
          Crc32({bytes, first.leaves.size() * sizeof(SubmapLeaf)})};
}

Age AgeOf(const Drive& drive) {
  return drive.frames.empty() ? Age{0, 0, 0} : AgeOf(drive.frames.front());
}

}  // namespace

Drive ReadDrive(const std::string& folder) {
  const auto path = [&](const char* name) { return (fs::path(folder) / name).string(); };
  if (!fs::is_directory(folder)) throw InputError(folder + ": there is no such folder");
  if (!fs::exists(path(kSubmapFileName))) {
    throw InputError(
        fmt::format("{}: has no {}; map the drive with `lamina run --loops on --out {}`", folder,
                    kSubmapFileName, folder));
  }
  Drive drive;
  drive.folder = folder;
  drive.frames = ReadSubmaps(path(kSubmapFileName));
  drive.config = LoadConfig(path("config.yaml"), {});
  const Trajectory poses = ReadTrajectory(path("trajectory_tum.txt"));
  const std::vector<FrameRow> rows = ReadPosedRows(folder, poses);
  if (rows.size() != poses.size()) {
    throw InputError(fmt::format("{}: frames.csv does not tell the pieces of the poses", folder));
  }
  for (std::size_t i = 0; i < poses.size(); ++i)
    drive.poses.push_back({poses[i], rows[i].own_piece, rows[i].status});
  return drive;
}

void SortByAge(std::vector<Drive>* drives) {
  for (Drive& drive : *drives) {
    std::stable_sort(
        drive.frames.begin(), drive.frames.end(),
        [](const SubmapFrame& a, const SubmapFrame& b) { return AgeOf(a) < AgeOf(b); });
  }
  std::stable_sort(drives->begin(), drives->end(),
                   [](const Drive& a, const Drive& b) { return AgeOf(a) < AgeOf(b); });
}

}  // namespace lamina
