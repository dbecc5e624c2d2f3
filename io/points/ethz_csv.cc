#include "io/points/ethz_csv.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <string_view>

#include "core/base/error.h"
#include "io/file/folder_list.h"
#include "io/file/text_input.h"
#include "io/points/scan_names.h"

namespace lamina {
namespace {

std::string PlainColumn(std::string_view name) {
  std::string plain;
  for (const char c : name) {
    if (c != ' ' && c != '\t' && c != '"') {
      plain += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    }
  }
  return plain;
}

// A table with a header. Columns are asked for by name first, then rows are read.
class CsvTable {
 public:
  static constexpr int kNone = -1;

  CsvTable(const std::string& path, std::string_view text) : lines_(path, text) {
    if (!lines_.Next()) throw InputError(fmt::format("{}: is empty: holds no header", path));
    std::string_view header = lines_.line();
    constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
    if (header.substr(0, 3) == kByteOrderMark) header.remove_prefix(3);
    delimiter_ = header.find(';') != std::string_view::npos ? ';' : ',';
    Split(header);
    for (const std::string_view word : words_) names_.push_back(PlainColumn(word));
  }

  int Find(const std::string& name) const {
    const auto found = std::find(names_.begin(), names_.end(), name);
    return found == names_.end() ? kNone : static_cast<int>(found - names_.begin());
  }
  int Require(const std::string& name) const {
    const int column = Find(name);
    if (column == kNone) {
      lines_.Fail(
          fmt::format("the header names no column {}; found {}", name, fmt::join(names_, ", ")));
    }
    return column;
  }

  bool NextRow() {
    if (!lines_.Next()) return false;
    Split(lines_.line());
    if (words_.size() < names_.size()) {
      lines_.Fail(fmt::format("has {} columns, the header {}", words_.size(), names_.size()));
    }
    return true;
  }
  std::string_view Word(int column) const { return words_[static_cast<std::size_t>(column)]; }
  double Number(int column) const {
    double value = 0.0;
    if (!ParseNumber(Word(column), &value)) {
      lines_.Fail(fmt::format("'{}' is not a number", Word(column).substr(0, 40)));
    }
    return value;
  }
  const LineReader& lines() const { return lines_; }

 private:
  void Split(std::string_view line) {
    words_.clear();
    for (std::size_t begin = 0; begin <= line.size();) {
      const std::size_t end = std::min(line.find(delimiter_, begin), line.size());
      std::string_view word = line.substr(begin, end - begin);
      while (!word.empty() && word.front() == ' ') word.remove_prefix(1);
      while (!word.empty() && word.back() == ' ') word.remove_suffix(1);
      words_.push_back(word);
      begin = end + 1;
    }
    // A delimiter at the end of a line starts no column.
    if (words_.size() > 1 && words_.back().empty()) words_.pop_back();
  }

  LineReader lines_;
  char delimiter_ = ',';
  std::vector<std::string> names_;
  std::vector<std::string_view> words_;
};

bool Increase(const Trajectory& poses) {
  return std::is_sorted(poses.begin(), poses.end(), [](const StampedPose& a, const StampedPose& b) {
    return a.stamp_ns <= b.stamp_ns;
  });
}

}  // namespace

std::vector<std::filesystem::path> ListHokuyoFiles(const std::filesystem::path& folder) {
  return ListFiles(folder, [](const std::string& name) {
    return name.rfind("Hokuyo_", 0) == 0 && LowerEnding(name) == ".csv";
  });
}

Scan ReadHokuyoCsv(const std::string& path, PointTimeUnit /*unit*/, PointTimeField* /*times*/) {
  const std::string text = ReadFile(path);
  CsvTable table(path, text);
  const std::array<int, 3> axes = {table.Require("x"), table.Require("y"), table.Require("z")};
  int intensity = table.Find("intensity");
  if (intensity == CsvTable::kNone) intensity = table.Find("intensities");
  Scan scan;
  while (table.NextRow()) {
    ScanPoint p;
    p.x = static_cast<float>(table.Number(axes[0]));
    p.y = static_cast<float>(table.Number(axes[1]));
    p.z = static_cast<float>(table.Number(axes[2]));
    if (intensity != CsvTable::kNone) p.intensity = static_cast<float>(table.Number(intensity));
    scan.points.push_back(p);
  }
  if (scan.points.empty()) throw InputError(fmt::format("{}: is empty: holds no points", path));
  return scan;
}

Trajectory ReadLeicaPoses(const std::string& path, bool* has_stamps) {
  const std::string text = ReadFile(path);
  CsvTable table(path, text);
  std::array<int, 12> columns;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    columns[i] = table.Require(fmt::format("t{}{}", i / 4, i % 4));
  }
  const int stamp = table.Find("timestamp");
  Trajectory poses;
  *has_stamps = stamp != CsvTable::kNone;
  std::vector<double> numbers(columns.size());
  while (table.NextRow()) {
    for (std::size_t i = 0; i < columns.size(); ++i) numbers[i] = table.Number(columns[i]);
    StampedPose pose;
    pose.T_world_lidar = PoseFromRowMajor(numbers, table.lines());
    if (*has_stamps) *has_stamps = ParseSecondsNs(table.Word(stamp), &pose.stamp_ns);
    poses.push_back(pose);
  }
  if (poses.empty()) throw InputError(fmt::format("{}: holds no pose", path));
  *has_stamps = *has_stamps && Increase(poses);
  for (std::size_t i = 0; i < poses.size() && !*has_stamps; ++i) {
    poses[i].stamp_ns = static_cast<StampNs>(i);
  }
  return poses;
}

}  // namespace lamina
