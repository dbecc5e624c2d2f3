#include "tools/report/data.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "core/base/angle.h"
#include "core/base/error.h"
#include "io/file/text_input.h"
#include "io/map/surfel_reader.h"
#include "io/map/trajectory_io.h"
#include "tools/eval/report.h"
#include "tools/metrics/match.h"
#include "tools/metrics/trajectory_metrics.h"
#include "tools/report/page.h"
#include "tools/results/piece_poses.h"
#include "tools/results/recording_part.h"
#include "tools/results/verdict/process_report.h"
#include "tools/watch/live/wire.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::size_t kMostValues = 20000;
constexpr double kCellM = 8.0;
// Further from the origin a cell's index would not fit; a surfel is only there by mistake.
constexpr double kFarthestM = 1e9;

// All of piece 0 unless `pieces` tells those of the poses.
std::string EncodePoses(const Trajectory& trajectory,
                        const std::vector<std::int64_t>& pieces = {}) {
  TrajectoryPage page;
  for (std::size_t i = 0; i < trajectory.size(); ++i) {
    page.poses.push_back({static_cast<std::int64_t>(i), trajectory[i].stamp_ns,
                          trajectory[i].T_world_lidar, pieces.empty() ? 0 : pieces[i]});
  }
  return Base64(EncodeTrajectory(page, ""));
}

json ReadMap(const std::string& path, std::size_t max_surfels) {
  SurfelReader reader(path);
  MapPage page;
  page.cell_size_m = kCellM;
  std::map<std::tuple<int, int, int>, std::size_t> cells;
  const std::size_t shown = std::min(reader.size(), max_surfels);
  std::size_t taken = 0;
  Surfel surfel;
  for (std::size_t i = 0; reader.Next(&surfel); ++i) {
    // As even as whole numbers are: surfel i is one of them if i * shown / size goes up with it.
    if ((i + 1) * shown / reader.size() == taken) continue;
    ++taken;
    if (surfel.centre.cwiseAbs().maxCoeff() > kFarthestM) {
      throw InputError(fmt::format("{}: surfel {} lies beyond {} km", path, i, kFarthestM / 1e3));
    }
    const Eigen::Vector3i at = (surfel.centre / kCellM).array().floor().cast<int>();
    const auto [cell, fresh] = cells.try_emplace({at.x(), at.y(), at.z()}, page.cells.size());
    if (fresh) page.cells.push_back({at.x(), at.y(), at.z(), {}});
    page.cells[cell->second].surfels.push_back(surfel);
  }
  return {{"cells", Base64(EncodeMap(page, ""))}, {"surfels", reader.size()}, {"shown", shown}};
}

// Several series over one axis, in groups of so many values that few enough remain.
class Series {
 public:
  explicit Series(std::size_t size) : group_((size + kMostValues - 1) / kMostValues) {
    group_ = std::max<std::size_t>(group_, 1);
  }
  std::size_t group() const { return group_; }

  // The first of each group.
  std::string Axis(const std::vector<double>& values) const {
    std::vector<double> kept;
    for (std::size_t i = 0; i < values.size(); i += group_) kept.push_back(values[i]);
    return Base64Floats(kept);
  }
  // The largest of each group.
  std::string Values(const std::vector<double>& values) const {
    std::vector<double> kept;
    for (std::size_t i = 0; i < values.size(); i += group_) {
      const auto begin = values.begin() + static_cast<std::ptrdiff_t>(i);
      const auto end = begin + static_cast<std::ptrdiff_t>(std::min(group_, values.size() - i));
      kept.push_back(*std::max_element(begin, end));
    }
    return Base64Floats(kept);
  }

 private:
  std::size_t group_;
};

// The columns of frames.csv that hold times, by name.
std::map<std::string, std::vector<double>> ReadTimes(const std::string& path) {
  const std::string text = ReadFile(path);
  LineReader lines(path, text);
  if (!lines.Next()) throw InputError(path + ": is empty");
  const std::vector<std::string_view> names = SplitAtCommas(lines.line());
  const auto is_time = [](std::string_view name) {
    return name.size() > 3 && name.substr(name.size() - 3) == "_ms";
  };
  if (std::none_of(names.begin(), names.end(), is_time)) {
    lines.Fail("the first line names no column of times, such as read_ms");
  }
  std::map<std::string, std::vector<double>> columns;
  while (lines.Next()) {
    const std::vector<std::string_view> cells = SplitAtCommas(lines.line());
    if (cells.size() != names.size()) {
      lines.Fail(
          fmt::format("has {} columns, the first line names {}", cells.size(), names.size()));
    }
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (!is_time(names[i])) continue;
      double value = 0.0;
      if (!ParseNumber(cells[i], &value)) {
        lines.Fail(fmt::format("{} must be a number, is '{}'", names[i], cells[i]));
      }
      columns[std::string(names[i])].push_back(value);
    }
  }
  return columns;
}

// Maps of the pieces beside the first one, as far as there is anything in them.
json ReadFurtherMaps(const fs::path& folder, const std::vector<std::int64_t>& pieces,
                     std::size_t max_surfels) {
  json maps = json::array();
  for (const std::int64_t piece : std::set<std::int64_t>(pieces.begin(), pieces.end())) {
    const std::string path = (folder / MapFileName(piece)).string();
    if (piece == 0 || !fs::exists(path)) continue;
    json map = ReadMap(path, max_surfels);
    map["piece"] = piece;
    maps.push_back(std::move(map));
  }
  return maps;
}

json ReadTimings(const std::string& path) {
  const auto columns = ReadTimes(path);
  const std::size_t scans = columns.empty() ? 0 : columns.begin()->second.size();
  const Series series(scans);
  std::vector<double> numbers(scans);
  for (std::size_t i = 0; i < scans; ++i) numbers[i] = static_cast<double>(i);
  json stages = json::object();
  for (const auto& [name, values] : columns) stages[name] = series.Values(values);
  return {{"group", series.group()}, {"scan", series.Axis(numbers)}, {"stages", stages}};
}

json ReadSummary(const std::string& path) {
  const json summary = json::parse(ReadFile(path), nullptr, false);
  if (summary.is_object()) return summary;
  throw InputError(path + ": is no JSON object");
}

// Of the first piece: those of others are in other frames.
json CompareWithTruth(const ReportSource& source) {
  const std::optional<RecordingPart> part = ReadRecordingPart(source.folder);
  const Trajectory truth = WithCalibration(
      part ? ReadPosesOfPart(source.truth, *part, {}) : ReadTrajectory(source.truth), source.calib);
  const char* const file = HasStamps(truth) ? "trajectory_tum.txt" : "trajectory_kitti.txt";
  const std::string path = (fs::path(source.folder) / file).string();
  const Trajectory all = ReadTrajectory(path);
  RequireMatchable({"the trajectory", all}, truth);
  const std::map<std::int64_t, Trajectory> pieces = SplitIntoPieces(path, all);
  const NamedTrajectory estimate{
      pieces.size() > 1 ? "the first piece of the trajectory" : "the trajectory",
      pieces.begin()->second};
  const ComparedTrajectory pairs = MatchPart(estimate, truth, source.tolerance_s);
  constexpr Alignment kAlignment = Alignment::kSe3;
  const SE3 T = AlignTrajectories(pairs.estimate, pairs.truth, kAlignment);
  const bool timed = HasStamps(pairs.estimate);
  std::vector<double> axis, metres, degrees;
  Trajectory shown;
  for (std::size_t i = 0; i < pairs.truth.size(); ++i) {
    const SE3 aligned = T * pairs.estimate[i].T_world_lidar;
    const SE3& truly = pairs.truth[i].T_world_lidar;
    axis.push_back(timed ? SecondsBetween(pairs.estimate[0].stamp_ns, pairs.estimate[i].stamp_ns)
                         : static_cast<double>(pairs.estimate[i].stamp_ns));
    metres.push_back((aligned.t - truly.t).norm());
    degrees.push_back(Degrees(RotationAngle(aligned, truly)));
    shown.push_back({pairs.truth[i].stamp_ns, T.Inverse() * truly});
  }
  const Series series(axis.size());
  return {{"poses", EncodePoses(shown)},
          {"figures", ToJson(ErrorsOf(pairs, kAlignment), kAlignment)},
          {"axis", series.Axis(axis)},
          {"axis_name", timed ? "s" : "scan"},
          {"group", series.group()},
          {"position_m", series.Values(metres)},
          {"rotation_deg", series.Values(degrees)}};
}

}  // namespace

json ReadReportData(const ReportSource& source) {
  const fs::path folder(source.folder);
  const auto path = [&](const char* name) { return (folder / name).string(); };
  if (!fs::is_directory(folder)) throw InputError(source.folder + ": is no folder");
  const Trajectory trajectory = ReadTrajectory(path("trajectory_tum.txt"));
  const std::vector<std::int64_t> pieces = ReadPieces(source.folder, trajectory);
  json data = {{"name", fs::absolute(folder / "").parent_path().filename().string()},
               {"trajectory", EncodePoses(trajectory, pieces)},
               {"map", ReadMap(path("map_surfels.ply"), source.max_surfels)},
               {"further_maps", ReadFurtherMaps(folder, pieces, source.max_surfels)}};
  if (fs::exists(path("frames.csv"))) data["timings"] = ReadTimings(path("frames.csv"));
  if (fs::exists(path("summary.json"))) {
    data["summary"] = ReadSummary(path("summary.json"));
    if (const auto verdict = ReadVerdict(data["summary"])) data["verdict"] = ToJson(*verdict);
  }
  if (!source.truth.empty()) data["truth"] = CompareWithTruth(source);
  return data;
}

}  // namespace lamina
