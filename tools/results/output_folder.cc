#include "tools/results/output_folder.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>

#include "core/base/error.h"
#include "tools/results/keyframe_file.h"
#include "tools/results/piece_trajectories.h"
#include "tools/results/submap_file.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// Without a last empty part, which a trailing slash leaves.
fs::path Canonical(const std::string& path) {
  const fs::path canonical = fs::weakly_canonical(fs::absolute(path));
  return canonical.has_filename() ? canonical : canonical.parent_path();
}

bool Exists(const std::string& folder, const char* name) {
  std::error_code ignored;
  return fs::exists(fs::path(folder) / name, ignored);
}

bool IsAmong(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

// What `lamina run` and `register` leave in their folder, by the name of the file.
bool IsResult(const std::string& name) {
  static const std::vector<std::string> kResults{"trajectory_tum.txt",
                                                 "trajectory_kitti.txt",
                                                 "map_surfels.ply",
                                                 "frames.csv",
                                                 "rounds.csv",
                                                 "covariance.csv",
                                                 "loops.csv",
                                                 "graph.g2o",
                                                 kSubmapFileName,
                                                 "trajectory_odometry_tum.txt",
                                                 "trajectory_odometry_kitti.txt",
                                                 "trajectory_live_tum.txt",
                                                 "trajectory_live_kitti.txt",
                                                 "summary.json"};
  return IsAmong(kResults, name) || PieceOfFile(name, MapFileName) ||
         PieceOfFile(name, PieceTrajectoryName);
}

// What other commands make from these, as a rule.
bool IsMadeFromResults(const std::string& name) {
  static const std::vector<std::string> kMade{"cloud.ply",  "cloud.pcd",      "cloud.las",
                                              "cloud.laz",  "cloud.copc.laz", "map.png",
                                              "doctor.html"};
  return IsAmong(kMade, name);
}

// What commands read of a folder of results beside these; and a session's own.
bool IsReadAsWell(const std::string& name) {
  static const std::vector<std::string> kRead{kKeyframeFileName, "config.yaml", "session.db",
                                              "session.db-wal",  "lock",        "map_tiles.db"};
  return IsAmong(kRead, name);
}

}  // namespace

bool IsWithin(const std::string& path, const std::string& folder) {
  const fs::path inner = Canonical(path), outer = Canonical(folder);
  return std::mismatch(outer.begin(), outer.end(), inner.begin(), inner.end()).first == outer.end();
}

bool IsSession(const std::string& folder) {
  return Exists(folder, "session.db") || Exists(folder, "lock");
}

bool HoldsResults(const std::string& folder) {
  return !IsSession(folder) && Exists(folder, "trajectory_tum.txt") &&
         (Exists(folder, "config.yaml") || Exists(folder, "summary.json"));
}

void CheckOutputFolder(const std::string& out, const std::string& scans) {
  if (out.empty()) throw OptionError("--out: is empty, must be a folder");
  if (IsWithin(out, scans)) {
    throw OptionError(fmt::format(
        "--out {}: is in the folder of the recording, {}; results must be kept apart from it", out,
        scans));
  }
  if (IsSession(out)) {
    throw OptionError(fmt::format(
        "--out {}: is a session of `lamina watch`, whose files would be replaced", out));
  }
  if (HoldsResults(out)) {
    spdlog::warn("{}: holds results of an earlier run, which will be replaced", out);
  }
}

void CheckReplacesNoResult(const std::string& option, const std::string& path) {
  const fs::path canonical = Canonical(path);
  const std::string folder = canonical.parent_path().string(), name = canonical.filename().string();
  if (!HoldsResults(folder) && !IsSession(folder)) return;
  if (!IsResult(name) && !IsReadAsWell(name)) return;
  throw OptionError(fmt::format("{} {}: is a result of the folder {}, which would be lost", option,
                                path, folder));
}

void RemoveStaleResults(const std::string& out, const std::vector<std::string>& written) {
  if (!HoldsResults(out)) return;
  std::vector<std::string> stale;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(out, ignored)) {
    const std::string name = entry.path().filename().string();
    const bool ours = IsResult(name) || IsMadeFromResults(name);
    if (!ours || !entry.is_regular_file(ignored)) continue;
    if (std::find(written.begin(), written.end(), name) != written.end()) continue;
    fs::remove(entry.path(), ignored);
    if (name != "summary.json") stale.push_back(name);
  }
  if (stale.empty()) return;
  std::sort(stale.begin(), stale.end());
  spdlog::warn("{}: removed {}: of the results that are replaced", out, fmt::join(stale, ", "));
}

}  // namespace lamina
