#include "tools/piece_poses.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>

#include "core/error.h"
#include "io/text_input.h"
#include "io/trajectory_io.h"

namespace lamina {

std::vector<std::string_view> SplitAtCommas(std::string_view line) {
  std::vector<std::string_view> cells;
  for (std::size_t begin = 0; begin <= line.size();) {
    const std::size_t end = std::min(line.find(',', begin), line.size());
    cells.push_back(line.substr(begin, end - begin));
    begin = end + 1;
  }
  return cells;
}

std::vector<std::int64_t> ReadPieces(const std::string& folder, std::size_t poses) {
  const std::string path = (std::filesystem::path(folder) / "frames.csv").string();
  if (!std::filesystem::exists(path)) return {};
  const std::string text = ReadFile(path);
  LineReader lines(path, text);
  if (!lines.Next()) return {};
  const std::vector<std::string_view> names = SplitAtCommas(lines.line());
  const auto column = [&](std::string_view name) {
    return static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
  };
  const std::size_t status = column("status"), piece = column("piece");
  std::vector<std::int64_t> pieces, of_all_scans;
  while (lines.Next() && piece < names.size() && status < names.size()) {
    const std::vector<std::string_view> cells = SplitAtCommas(lines.line());
    if (cells.size() != names.size()) return {};
    const auto is = [&](const char* text_of) { return cells[status] == text_of; };
    double number = 0.0;
    if (!ParseNumber(cells[piece], &number)) lines.Fail("piece must be a whole number");
    of_all_scans.push_back(static_cast<std::int64_t>(number));
    if (!is("first") && !is("tracked") && !is("degenerate") && !is("lost")) continue;
    pieces.push_back(of_all_scans.back());
  }
  if (pieces.size() == poses) return pieces;
  return of_all_scans.size() == poses ? of_all_scans : std::vector<std::int64_t>();
}

std::map<std::int64_t, Trajectory> SplitIntoPieces(const std::string& path,
                                                   const Trajectory& poses) {
  const std::filesystem::path file(path);
  const std::string name = file.filename().string();
  std::vector<std::int64_t> pieces;
  if (name == "trajectory_tum.txt" || name == "trajectory_kitti.txt") {
    pieces = ReadPieces(file.parent_path().string(), poses.size());
  }
  std::map<std::int64_t, Trajectory> split;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    split[pieces.empty() ? 0 : pieces[i]].push_back(poses[i]);
  }
  return split;
}

Trajectory ReadFirstPiece(const std::string& folder) {
  const Trajectory all =
      ReadTrajectory((std::filesystem::path(folder) / "trajectory_tum.txt").string());
  const std::vector<std::int64_t> pieces = ReadPieces(folder, all.size());
  if (pieces.empty()) return all;
  Trajectory first;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (pieces[i] == 0) first.push_back(all[i]);
  }
  if (first.size() < all.size()) {
    spdlog::warn(
        "{}: {} of {} poses are of pieces of the map that are not connected to the first one, and "
        "left out",
        folder, all.size() - first.size(), all.size());
  }
  return first;
}

}  // namespace lamina
