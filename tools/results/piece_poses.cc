#include "tools/results/piece_poses.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>

#include "core/base/error.h"
#include "io/file/text_input.h"
#include "io/map/trajectory_io.h"
#include "tools/results/output_folder.h"

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

std::vector<FrameRow> ReadFrameRows(const std::string& folder) {
  const std::string path = (std::filesystem::path(folder) / "frames.csv").string();
  if (!std::filesystem::exists(path)) return {};
  const std::string text = ReadFile(path);
  LineReader lines(path, text);
  if (!lines.Next()) return {};
  const std::vector<std::string_view> names = SplitAtCommas(lines.line());
  const auto column = [&](std::string_view name) {
    return static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
  };
  const std::size_t status = column("status"), stamp = column("stamp_s"), points = column("points");
  const std::size_t own = column("piece"), drive = column("drive");
  const std::size_t piece = column("frame") < names.size() ? column("frame") : own;
  const std::size_t covariance = column("cov_rx");
  const bool has_covariance = column("cov_z") < names.size() && column("cov_z") == covariance + 5;
  if (std::max(status, own) == names.size()) return {};
  std::vector<FrameRow> rows;
  while (lines.Next()) {
    const std::vector<std::string_view> cells = SplitAtCommas(lines.line());
    if (cells.size() != names.size()) return {};
    const auto is = [&](const char* text_of) { return cells[status] == text_of; };
    const auto number = [&](std::size_t at) {
      double value = 0.0;
      if (!ParseNumber(cells[at], &value)) {
        lines.Fail(fmt::format("{} must be a whole number", names[at]));
      }
      return value;
    };
    FrameRow& row = rows.emplace_back();
    row.piece = static_cast<std::int64_t>(number(piece));
    row.own_piece = static_cast<std::int64_t>(number(own));
    if (drive < names.size()) row.drive = static_cast<std::int64_t>(number(drive));
    row.status = cells[status];
    row.has_pose = is("first") || is("tracked") || is("degenerate") || is("lost");
    StampNs stamp_ns = 0;
    if (stamp < names.size() && ParseSecondsNs(cells[stamp], &stamp_ns)) row.stamp_ns = stamp_ns;
    if (points < names.size()) row.points = static_cast<std::size_t>(number(points));
    for (std::size_t i = 0; has_covariance && i < 6; ++i) {
      row.covariance += (i > 0 ? "," : "") + std::string(cells[covariance + i]);
    }
  }
  return rows;
}

std::vector<FrameRow> ReadPosedRows(const std::string& folder, const Trajectory& poses) {
  std::vector<FrameRow> rows = ReadFrameRows(folder);
  if (rows.empty()) return {};
  rows.erase(
      std::remove_if(rows.begin(), rows.end(), [](const FrameRow& row) { return !row.has_pose; }),
      rows.end());
  const auto refuse = [&](const std::string& why) {
    throw InputError(
        fmt::format("{}: frames.csv and trajectory_tum.txt are not of one run: {}", folder, why));
  };
  const std::size_t both = std::min(rows.size(), poses.size());
  for (std::size_t i = 0; i < both; ++i) {
    if (rows[i].stamp_ns && *rows[i].stamp_ns != poses[i].stamp_ns) {
      refuse(fmt::format("pose {} has another stamp", i));
    }
  }
  if (rows.size() == poses.size()) return rows;
  if (!IsSession(folder)) {
    refuse(fmt::format("{} scans with poses against {} poses", rows.size(), poses.size()));
  }
  return {};
}

std::vector<std::int64_t> ReadPieces(const std::string& folder, const Trajectory& poses) {
  std::vector<std::int64_t> pieces;
  for (const FrameRow& row : ReadPosedRows(folder, poses)) pieces.push_back(row.piece);
  return pieces;
}

std::map<std::int64_t, Trajectory> SplitIntoPieces(const std::string& path, const Trajectory& poses,
                                                   std::size_t first_line) {
  const std::filesystem::path file(path);
  const std::string name = file.filename().string(), folder = file.parent_path().string();
  std::vector<std::int64_t> pieces;
  if (name == "trajectory_tum.txt") pieces = ReadPieces(folder, poses);
  if (name == "trajectory_kitti.txt") {
    for (const FrameRow& row : ReadFrameRows(folder)) pieces.push_back(row.piece);
    const std::size_t end = first_line + poses.size();
    if (!pieces.empty() && pieces.size() < end) {
      if (!IsSession(folder)) {
        throw InputError(fmt::format(
            "{}: frames.csv and {} are not of one run: {} scans against {} poses or more", folder,
            name, pieces.size(), end));
      }
      pieces.clear();
    }
  }
  std::map<std::int64_t, Trajectory> split;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    split[pieces.empty() ? 0 : pieces[first_line + i]].push_back(poses[i]);
  }
  return split;
}

Trajectory ReadPiece(const std::string& folder, std::int64_t piece, std::vector<FrameRow>* rows) {
  const Trajectory all =
      ReadTrajectory((std::filesystem::path(folder) / "trajectory_tum.txt").string());
  const std::vector<FrameRow> of_all = ReadPosedRows(folder, all);
  if (rows != nullptr) rows->clear();
  if (of_all.empty() && piece == 0) return all;
  Trajectory own;
  for (std::size_t i = 0; i < of_all.size(); ++i) {
    if (of_all[i].piece != piece) continue;
    own.push_back(all[i]);
    if (rows != nullptr) rows->push_back(of_all[i]);
  }
  if (own.empty())
    throw InputError(fmt::format("{}: has no poses in the frame of piece {}", folder, piece));
  if (own.size() < all.size()) {
    spdlog::warn(
        "{}: {} of {} poses are of pieces of the map that are not connected to piece {}, and left "
        "out",
        folder, all.size() - own.size(), all.size(), piece);
  }
  return own;
}

}  // namespace lamina
