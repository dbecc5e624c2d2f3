#include "tools/results/run_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>

#include "core/base/error.h"
#include "core/base/median.h"
#include "io/file/text_input.h"
#include "io/map/trajectory_io.h"
#include "tools/results/piece_poses.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// Largest integer that a figure of a scan may be: every one fits into a double.
constexpr double kMostInteger = 9e15;

bool HasPoseOfItsOwn(std::string_view status) {
  return status == "first" || status == "tracked" || status == "degenerate" || status == "lost";
}

// Puts a cell of the table into the scan; false if it is no value of the column.
using CellReader = std::function<bool(std::string_view cell, RunScan* scan)>;

// False if it is no number that an integer holds.
bool ReadInteger(std::string_view cell, std::int64_t* integer) {
  double value = 0.0;
  if (!ParseNumber(cell, &value) || !(std::abs(value) <= kMostInteger)) return false;
  *integer = static_cast<std::int64_t>(value);
  return true;
}

CellReader Integer(std::int64_t ScanRecord::*member) {
  return [member](std::string_view cell, RunScan* scan) {
    return ReadInteger(cell, &(scan->record.*member));
  };
}

bool ReadFrame(std::string_view cell, RunScan* scan) {
  return ReadInteger(cell, &scan->frame.emplace());
}

// Drives of a merged map are recordings of their own.
bool ReadDrive(std::string_view cell, RunScan* scan) {
  std::int64_t drive = 0;
  if (!ReadInteger(cell, &drive)) return false;
  scan->record.sequence = fmt::format("drive {}", drive);
  return true;
}

// May be NaN: a figure that was not measured.
CellReader Figure(double ScanRecord::*member) {
  return [member](std::string_view cell, RunScan* scan) {
    return ParseNumber(cell, &(scan->record.*member));
  };
}

bool ReadStatus(std::string_view cell, RunScan* scan) {
  scan->record.status = cell;
  scan->record.skipped = !HasPoseOfItsOwn(cell);
  return !cell.empty();
}

// Any two of them are a time apart that fits, too.
bool ReadStamp(std::string_view cell, RunScan* scan) {
  constexpr StampNs kLargest = 4'000'000'000'000'000'000;
  StampNs& stamp = scan->record.stamp_ns;
  return scan->has_stamp = ParseSecondsNs(cell, &stamp) && stamp < kLargest && stamp > -kLargest;
}

struct Column {
  const char* name;
  CellReader read;
  // What cannot be told without it; empty: nothing is missing; null: the table is none without it.
  const char* without;
};

const std::vector<Column>& Columns() {
  static const std::vector<Column> columns{
      {"scan", Integer(&ScanRecord::scan), nullptr},
      {"status", ReadStatus, nullptr},
      {"stamp_s", ReadStamp, "gaps, jumps of speed and poses"},
      {"piece", Integer(&ScanRecord::piece), "pieces of the map"},
      {"frame", ReadFrame, ""},
      {"drive", ReadDrive, ""},
      {"points", Integer(&ScanRecord::points), "scans of few points"},
      {"clusters", Integer(&ScanRecord::clusters), "overlap and fit"},
      {"matched", Integer(&ScanRecord::matched), "overlap and fit"},
      {"iterations", Integer(&ScanRecord::iterations), "matches that did not converge"},
      {"inlier_share", Figure(&ScanRecord::inlier_share), "shares of inliers"},
      {"residual_m", Figure(&ScanRecord::residual_m), "residuals"},
      {"unobservable_directions", Integer(&ScanRecord::unobservable_directions),
       "how many directions are open"},
      {"worst_sigma_m", Figure(&ScanRecord::worst_sigma_m), "how far directions are open"},
      {"odometry_ms", Figure(&ScanRecord::odometry_ms), "slow scans"},
      {"map_ms", Figure(&ScanRecord::map_ms), "slow scans"},
  };
  return columns;
}

// frames.csv.
class TableReader {
 public:
  TableReader(std::string path, RunTable* table) : path_(std::move(path)), table_(table) {}

  void Read() {
    if (!fs::exists(path_)) {
      throw InputError(path_ + ": is missing; a run or a session writes it when it ends");
    }
    const std::string text = ReadFile(path_);
    LineReader lines(path_, text);
    if (!lines.Next()) throw InputError(path_ + ": is empty");
    FindColumns(SplitAtCommas(lines.line()));
    while (lines.Next()) ReadLine(lines);
    if (table_->scans.empty() && bad_ == 0) throw InputError(path_ + ": names no scan");
    if (table_->scans.empty()) {
      throw InputError(fmt::format("{}: not one of its {} lines can be used; the first: {}", path_,
                                   bad_, first_bad_));
    }
    if (bad_ == 0) return;
    table_->notes.push_back(
        fmt::format("frames.csv: {} {} left out that cannot be used; the first: {}", bad_,
                    bad_ == 1 ? "line" : "lines", first_bad_));
  }

 private:
  void FindColumns(const std::vector<std::string_view>& names) {
    names_.assign(names.begin(), names.end());
    for (const Column& column : Columns()) {
      const auto at = std::find(names.begin(), names.end(), column.name);
      if (at != names.end()) {
        readers_[static_cast<std::size_t>(at - names.begin())] = &column;
      } else if (column.without == nullptr) {
        throw InputError(fmt::format("{}: the first line names no column {}", path_, column.name));
      } else if (column.without[0] != '\0') {
        table_->notes.push_back(
            fmt::format("frames.csv has no column {}: without {}", column.name, column.without));
      }
    }
  }

  void ReadLine(const LineReader& lines) {
    RunScan scan;
    scan.record.inlier_share = scan.record.residual_m = scan.record.worst_sigma_m = kUnknown;
    const std::string problem = ReadCells(SplitAtCommas(lines.line()), &scan);
    if (scan.frame) scan.record.piece = *scan.frame;
    if (problem.empty()) {
      table_->scans.push_back(std::move(scan));
    } else if (bad_++ == 0) {
      first_bad_ = fmt::format("line {} {}", lines.number(), problem);
    }
  }

  // What is wrong with the line; empty: nothing.
  std::string ReadCells(const std::vector<std::string_view>& cells, RunScan* scan) const {
    if (cells.size() != names_.size()) {
      return fmt::format("has {} columns, the first line names {}", cells.size(), names_.size());
    }
    for (const auto& [at, column] : readers_) {
      if (column->read(cells[at], scan)) continue;
      return fmt::format("has '{}' for {}", cells[at], column->name);
    }
    if (!table_->scans.empty() && scan->record.scan <= table_->scans.back().record.scan) {
      return fmt::format("has scan {} behind scan {}", scan->record.scan,
                         table_->scans.back().record.scan);
    }
    return "";
  }

  std::string path_;
  RunTable* table_;
  std::vector<std::string> names_;
  std::map<std::size_t, const Column*> readers_;  // by number of the column
  std::size_t bad_ = 0;
  std::string first_bad_;
};

void ReadConfig(const std::string& path, RunTable* table) {
  constexpr const char* kAssumed = ": the default configuration is assumed";
  if (!fs::exists(path)) {
    table->notes.push_back(std::string("config.yaml is missing") + kAssumed);
    return;
  }
  try {
    table->config = LoadConfig(path, {});
  } catch (const OptionError& error) {
    // Options come and go from version to version.
    table->notes.push_back(error.what() + std::string(kAssumed));
  }
}

void ReadSummary(const std::string& path, RunTable* table) {
  if (!fs::exists(path)) {
    table->notes.push_back("summary.json is missing: the run or session has not ended in order");
    return;
  }
  table->summary = nlohmann::json::parse(ReadFile(path), nullptr, false);
  if (!table->summary.is_object()) throw InputError(path + ": is no JSON object");
}

// The recording of each piece (those of an inbox are pieces of their own), and whether its stamps
// were recorded, which older runs do not tell.
void NameRecordings(RunTable* table) {
  struct Origin {
    std::string recording;
    bool recorded_stamps = true;
  };
  std::map<std::int64_t, Origin> origins;
  const nlohmann::json pieces = table->summary.value("pieces", nlohmann::json());
  for (const nlohmann::json& piece : pieces.is_array() ? pieces : nlohmann::json::array()) {
    if (!piece.is_object() || !piece.contains("piece") || !piece.contains("recording")) continue;
    if (!piece["piece"].is_number_integer() || !piece["recording"].is_string()) continue;
    const auto recorded = piece.find("recorded_stamps");
    origins[piece["piece"]] = {piece["recording"], recorded == piece.end() || *recorded != false};
  }
  for (RunScan& scan : table->scans) {
    const auto known = origins.find(scan.record.piece);
    scan.record.recorded_stamp = known == origins.end() || known->second.recorded_stamps;
    if (known != origins.end()) scan.record.sequence = known->second.recording;
  }
}

// Poses go to scans by their stamps. Scans of several recordings may share one: then in order.
void TakePoses(const std::string& path, RunTable* table) {
  if (!fs::exists(path)) {
    table->notes.push_back("trajectory_tum.txt is missing: without pictures and jumps of speed");
    return;
  }
  std::map<StampNs, std::deque<SE3>> poses;
  const Trajectory trajectory = ReadTrajectory(path);
  for (const StampedPose& pose : trajectory) poses[pose.stamp_ns].push_back(pose.T_world_lidar);
  std::size_t posed = 0, without = 0;
  for (RunScan& scan : table->scans) {
    if (scan.record.skipped || !scan.has_stamp) continue;
    const auto at = poses.find(scan.record.stamp_ns);
    if (at == poses.end() || at->second.empty()) {
      ++without;
      continue;
    }
    scan.record.T_world_lidar = at->second.front();
    scan.has_pose = true;
    at->second.pop_front();
    ++posed;
  }
  if (without == 0 && posed == trajectory.size()) return;
  table->notes.push_back(fmt::format(
      "frames.csv and trajectory_tum.txt do not tell of the same scans: {} scans have no pose, {} "
      "of {} poses have no scan",
      without, trajectory.size() - posed, trajectory.size()));
}

void MeasureWay(RunTable* table) {
  std::map<std::int64_t, const RunScan*> last;  // by piece
  for (RunScan& scan : table->scans) {
    if (!scan.has_pose) continue;
    const auto [at, fresh] = last.try_emplace(scan.record.piece, &scan);
    const RunScan& before = *at->second;
    scan.way_m =
        fresh ? 0.0
              : before.way_m + (scan.record.T_world_lidar.t - before.record.T_world_lidar.t).norm();
    at->second = &scan;
  }
}

void MeasureIntervals(RunTable* table) {
  std::map<std::string, StampNs> newest;  // by recording
  for (RunScan& scan : table->scans) {
    if (!scan.has_stamp) continue;
    const auto [at, fresh] = newest.try_emplace(scan.record.sequence, scan.record.stamp_ns);
    if (!fresh) scan.interval_s = SecondsBetween(at->second, scan.record.stamp_ns);
    at->second = std::max(at->second, scan.record.stamp_ns);
  }
}

std::vector<double> IntervalsOf(const RunTable& table, const std::string& sequence) {
  std::vector<double> intervals;
  for (const RunScan& scan : table.scans) {
    if (scan.record.sequence == sequence && scan.interval_s > 0.0) {
      intervals.push_back(scan.interval_s);
    }
  }
  return intervals;
}

}  // namespace

RunTable ReadRunTable(const std::string& folder) {
  if (!fs::is_directory(folder)) throw InputError(folder + ": is no folder");
  const auto path = [&](const char* name) { return (fs::path(folder) / name).string(); };
  RunTable table;
  table.folder = folder;
  TableReader(path("frames.csv"), &table).Read();
  ReadConfig(path("config.yaml"), &table);
  ReadSummary(path("summary.json"), &table);
  NameRecordings(&table);
  TakePoses(path("trajectory_tum.txt"), &table);
  MeasureWay(&table);
  MeasureIntervals(&table);
  return table;
}

double UsualInterval(const RunTable& table, const std::string& sequence) {
  std::vector<double> intervals = IntervalsOf(table, sequence);
  if (intervals.empty()) return kUnknown;
  const double share = table.config.scans.T_vehicle_lidar.empty() ? 0.5 : 0.9;
  return Quantile(&intervals, share);
}

bool HasEvenIntervals(const RunTable& table, const std::string& sequence) {
  constexpr double kEven = 0.2, kMost = 0.7;
  const double usual_s = UsualInterval(table, sequence);
  const std::vector<double> intervals = IntervalsOf(table, sequence);
  const auto even = std::count_if(intervals.begin(), intervals.end(), [&](double interval_s) {
    return std::abs(interval_s - usual_s) <= kEven * usual_s;
  });
  return static_cast<double>(even) >= kMost * static_cast<double>(intervals.size());
}

}  // namespace lamina
