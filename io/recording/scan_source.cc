#include "io/recording/scan_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <tuple>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/first_readable.h"
#include "core/base/parallel.h"
#include "io/container/message_container.h"
#include "io/file/text_input.h"
#include "io/points/ethz_csv.h"
#include "io/points/scan_file.h"
#include "io/points/scan_names.h"
#include "io/recording/capture_scans.h"
#include "io/recording/message_topics.h"
#include "io/recording/scan_layout.h"
#include "io/recording/vehicle_scans.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// Stamps of the recording and of the points that are further apart come from different clocks.
constexpr double kSameClockNs = 10e9;

// A sweep cannot be longer than the time between two by as much.
constexpr double kLongerThanPeriod = 1.5;
constexpr StampNs kUnreadable = std::numeric_limits<StampNs>::min();

std::string DescribeFoldersBelow(const fs::path& folder) {
  const std::vector<FolderOfScans> found = FoldersBelow(folder);
  std::string text;
  for (const FolderOfScans& below : found) {
    text += fmt::format("{}{} holds {}", text.empty() ? "; but its folder " : ", ",
                        below.folder.string(), below.scans);
  }
  if (found.empty()) return "";
  return text + (found.size() == 1 ? ": give that one" : ": give one of these");
}

class FileScanSource final : public ScanSource {
 public:
  FileScanSource(const ScanLayout& layout, const ScanSourceOptions& options) : options_(options) {
    // Before all others: a cloud of reference may lie beside such scans.
    if (layout.only.empty() && OpenEthz(layout.scans)) {
      DescribeScans();
      return;
    }
    FindFiles(layout);
    FindStamps(layout);
    DescribeScans();
    if (MayExist(layout.calibration)) {
      T_camera_lidar_ = ReadKittiCalibration(layout.calibration.string()).value_or(SE3());
    }
  }

  std::size_t size() const override { return files_.size(); }
  std::string Name(std::size_t i) const override { return files_.at(i).string(); }
  StampNs Stamp(std::size_t i) const override { return stamps_.at(i); }
  bool recorded_stamps() const override { return recorded_stamps_; }
  SE3 T_camera_lidar() const override { return T_camera_lidar_; }
  RecordingDescription Describe() const override { return described_; }

  Scan Read(std::size_t i) const override {
    return ReadStampedScan(Name(i), Stamp(i), recorded_stamps_, options_);
  }

  PointTimeField PointTimes(std::size_t i) const override {
    PointTimeField times;
    ReadScanFile(Name(i), options_.point_time_unit, &times);
    return times;
  }

 private:
  void FindFiles(const ScanLayout& layout) {
    if (!layout.only.empty()) {
      files_ = {layout.only};
      return;
    }
    files_ = ListScans(layout.scans, ScanName::kPoints);
    if (files_.empty() && layout.text_scans) files_ = ListScans(layout.scans, ScanName::kText);
    if (!files_.empty()) return;
    throw InputError(fmt::format("{}: holds no scans ({}, Hokuyo_*.csv{}){}", layout.scans.string(),
                                 FolderPatterns(), layout.text_scans ? ", *.txt" : "",
                                 DescribeFoldersBelow(layout.scans)));
  }

  void FindStamps(const ScanLayout& layout) {
    if (MayExist(layout.stamps)) {
      stamps_ = ReadStamps(layout.stamps.string(), files_);
      described_.stamps = "from " + layout.stamps.filename().string();
    } else {
      stamps_ = StampsFromNames(files_);
      if (!stamps_.empty()) {
        described_.stamps = "from the files' names";
        SortByStamp();
      }
      // A recording's own layout has its stamps in one place.
      if (stamps_.empty() && layout.only.empty() && layout.stamps.parent_path() == layout.scans) {
        FindStampsAbove(layout);
      }
      if (stamps_.empty()) FindStampsInPoints();
    }
    MakeUpMissingStamps();
  }

  // A times.txt beside the folder of the scans: used if it has a line for each, else named.
  void FindStampsAbove(const ScanLayout& layout) {
    const fs::path above = fs::weakly_canonical(fs::absolute(layout.scans)).parent_path();
    for (const char* name : {"times.txt", "timestamps.txt"}) {
      const fs::path file = above / name;
      std::error_code ignored;
      if (!stamps_.empty() || !fs::is_regular_file(file, ignored)) continue;
      try {
        const std::size_t lines = CountStamps(file.string());
        if (lines == files_.size() || NamesAreLineNumbers(files_, lines)) {
          stamps_ = ReadStamps(file.string(), files_);
          described_.stamps = "from " + file.string();
        } else {
          described_.doubts.push_back(fmt::format("{} is not used: {} stamps for {} scans",
                                                  file.string(), lines, files_.size()));
        }
      } catch (const InputError& error) {
        described_.doubts.push_back(fmt::format("not used: {}", error.what()));
      }
    }
  }

  void DoubtPeriod(double sweep_s) {
    if (sweep_s <= kLongerThanPeriod * options_.frame_period_s) return;
    described_.doubts.push_back(fmt::format(
        "the times of a scan's points span {:.3g} s, more than stamps are made up apart: the "
        "sensor's period is wanted (scans.frame_period_s={:.2g}), without it the trajectory's "
        "times are wrong",
        sweep_s, sweep_s));
  }

  // Of clocks that were written with too few digits, or that stand still.
  static std::size_t SameAsBefore(const std::vector<StampNs>& clocks) {
    std::size_t same = 0;
    for (std::size_t i = 1; i < clocks.size(); ++i) same += clocks[i] == clocks[i - 1] ? 1 : 0;
    return same;
  }

  // The clock of the points, if the first file that can be read has one. Of files that cannot be
  // read, the stamp is just behind that of the one before.
  void FindStampsInPoints() {
    const auto read = [this](std::size_t i) {
      return ReadScanFile(files_[i].string(), options_.point_time_unit);
    };
    const auto readable = FirstReadable(0, files_.size(), [&](std::size_t i) {
      const Scan scan = read(i);
      return std::make_pair(scan.stamp_ns, SpanOfTimes(scan.time_s).length_s());
    });
    if (!readable) return;
    const auto [first, sweep_s] = *readable;
    if (first == 0) return DoubtPeriod(sweep_s);
    const auto clock_of = [&](std::size_t i) {
      try {
        return read(i).stamp_ns;
      } catch (const InputError&) {
        return kUnreadable;
      }
    };
    std::vector<StampNs> clocks(files_.size());
    ParallelChunks(files_.size(), 1, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) clocks[i] = clock_of(i);
    });
    std::size_t without = 0;
    for (std::size_t i = 0; i < clocks.size(); ++i) {
      without += clocks[i] == 0 ? 1 : 0;
      if (clocks[i] == kUnreadable) clocks[i] = (i > 0 ? clocks[i - 1] : first) + 1;
    }
    if (without > 0) {
      described_.doubts.push_back(fmt::format(
          "the points of some scans have times of a clock, those of {} have none: not used as "
          "stamps",
          without));
      return;
    }
    if (const std::size_t same = SameAsBefore(clocks); 2 * same > clocks.size()) {
      described_.doubts.push_back(fmt::format(
          "the clock in the points of {} scans is that of the scan before: not used as stamps",
          same));
      return;
    }
    stamps_ = std::move(clocks);
    described_.stamps = "from the points' times, readings of a clock";
    const auto back = std::adjacent_find(stamps_.begin(), stamps_.end(), std::greater<>());
    if (back == stamps_.end()) return;
    const auto at = static_cast<std::size_t>(back - stamps_.begin());
    described_.doubts.push_back(fmt::format(
        "the order of names is not that of time: {} is {:.3f} s before {}; the clock of the points "
        "counts",
        files_[at + 1].filename().string(), SecondsBetween(stamps_[at + 1], stamps_[at]),
        files_[at].filename().string()));
    SortByStamp();
  }

  // After the stamps are known: what the order is by, and whether it is plausible.
  void DescribeScans() {
    std::map<std::string, std::size_t> endings;
    for (const fs::path& file : files_) ++endings[file.extension().string()];
    for (const auto& [ending, count] : endings) {
      described_.scans += fmt::format("{}{} {} *{}", described_.scans.empty() ? "" : ", ", count,
                                      count == 1 ? "file" : "files", ending);
    }
    described_.scans +=
        by_stamp_ ? ", in the order of their stamps" : ", in the order of their names";
    if (!recorded_stamps_) {
      described_.stamps =
          fmt::format("made up, {} s apart (scans.frame_period_s)", options_.frame_period_s);
      return;
    }
    std::size_t back = 0, first = 0;
    for (std::size_t i = 1; i < stamps_.size(); ++i) {
      if (stamps_[i] > stamps_[i - 1]) continue;
      if (back++ == 0) first = i;
    }
    if (back == 0) return;
    described_.doubts.push_back(fmt::format(
        "{} stamps are not after the one before, first that of {}, {:.3f} s before: such scans are "
        "skipped, or begin a piece if there are many in a row; do the stamps belong to these "
        "files?",
        back, files_[first].filename().string(),
        SecondsBetween(stamps_[first], stamps_[first - 1])));
  }

  // False if there are no such files.
  bool OpenEthz(const fs::path& folder) {
    files_ = ListHokuyoFiles(folder);
    const fs::path poses_file = folder / "pose_scanner_leica.csv";
    if (!files_.empty() && MayExist(poses_file)) {
      bool has_stamps = false;
      const Trajectory poses = ReadLeicaPoses(poses_file.string(), &has_stamps);
      if (has_stamps && poses.size() == files_.size()) {
        for (const StampedPose& pose : poses) stamps_.push_back(pose.stamp_ns);
        described_.stamps = "from " + poses_file.filename().string();
      }
    }
    if (files_.empty()) return false;
    MakeUpMissingStamps();
    return true;
  }

  void MakeUpMissingStamps() {
    recorded_stamps_ = !stamps_.empty();
    for (std::size_t i = stamps_.size(); i < files_.size(); ++i) {
      stamps_.push_back(MadeUpStamp(i, options_));
    }
  }

  // Stamps that come with the files say the order better than names do: 1.25 comes before 1.5.
  void SortByStamp() {
    by_stamp_ = true;
    std::vector<std::pair<StampNs, fs::path>> order;
    for (std::size_t i = 0; i < files_.size(); ++i) order.emplace_back(stamps_[i], files_[i]);
    std::stable_sort(order.begin(), order.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t i = 0; i < files_.size(); ++i) std::tie(stamps_[i], files_[i]) = order[i];
  }

  const ScanSourceOptions options_;
  std::vector<fs::path> files_;
  std::vector<StampNs> stamps_;
  bool recorded_stamps_ = false;  // not made up from frame_period_s
  bool by_stamp_ = false;         // the order of files_
  RecordingDescription described_;
  SE3 T_camera_lidar_;
};

}  // namespace

void ScanSourceOptions::Visit(OptionVisitor& v) {
  v.Number("frame_period_s", &frame_period_s, 1e-6, 1e6);
  v.EnumChoice("point_time_unit", &point_time_unit, {"auto", "s", "ms", "us", "ns"});
  constexpr std::size_t kMostTopicBytes = 1024;
  v.Text("topic", &topic, kMostTopicBytes);
  constexpr double kMostM = 100.0;
  v.FolderPoses("T_vehicle_lidar", &T_vehicle_lidar, kMostM);
}

bool HoldsMessages(const std::string& path) {
  std::error_code ignored;
  return IsMessageContainer(path) &&
         (!fs::is_directory(path, ignored) || ListScans(path, ScanName::kPoints).empty());
}

std::unique_ptr<ScanSource> OpenScans(const std::string& path, const ScanSourceOptions& options) {
  CheckOptions(options, "scans");
  if (!options.T_vehicle_lidar.empty()) return std::make_unique<VehicleScans>(path, options);
  if (HoldsMessages(path)) return OpenMessages(path, options);
  if (HoldsPackets(path)) return std::make_unique<CaptureScans>(path, options);
  if (!options.topic.empty()) {
    throw InputError(fmt::format(
        "{}: is no container of messages or packets, so there is no topic '{}' (scans.topic)", path,
        options.topic));
  }
  return std::make_unique<FileScanSource>(FindScanLayout(path), options);
}

StampNs MadeUpStamp(std::size_t i, const ScanSourceOptions& options) {
  return std::llround(static_cast<double>(i) * options.frame_period_s * 1e9);
}

namespace {

// Whether times are no offsets from the stamp, but readings of a clock that is near zero: offsets
// begin or end within a sweep of it.
bool BeyondASweep(const TimeSpan& span) {
  constexpr double kBeyond = 0.9;
  return std::max(span.low_s, -span.high_s) > kBeyond * span.length_s();
}

// Readings of a clock near zero are told from offsets by a stamp that reads the same: of a
// simulation's time, or, an hour's having begun, of a clock that counts within the hour. Others, of
// a part of the sweep, stay as they are.
void FitClockNearZero(StampNs stamp_ns, Scan* scan) {
  constexpr double kSameS = 0.5, kHourS = 3600.0, kEpochS = 1e9;
  constexpr double kNearS = 2.0;  // more than offsets and kSameS together
  const double stamp_s = kSecondsPerNs * static_cast<double>(stamp_ns);
  const bool within_hour = stamp_s > kEpochS;
  const double reads_s = within_hour ? std::fmod(stamp_s, kHourS) : stamp_s;
  // The times of most scans need not be looked at.
  if (scan->time_s.empty() || reads_s > kNearS) return;
  const TimeSpan span = SpanOfTimes(scan->time_s);
  if (!BeyondASweep(span) || std::abs(reads_s - span.low_s) > kSameS) return;
  const double origin_s = within_hour ? span.low_s : stamp_s;
  for (float& t : scan->time_s) t = static_cast<float>(static_cast<double>(t) - origin_s);
}

// Times by stamps that are made up tell where in its sweep a point was measured, and no more. Those
// that lie beyond a sweep from the stamp are readings of a clock that began with the recording, and
// count from the earliest. A sweep that is longer than stamps are apart is taken to last that long.
void FitMadeUpStamp(double period_s, Scan* scan) {
  const auto longer = [&](const TimeSpan& span) {
    return span.length_s() > kLongerThanPeriod * period_s;
  };
  TimeSpan span = SpanOfTimes(scan->time_s);
  if (!BeyondASweep(span) && !longer(span)) return;
  if (longer(span)) span = UsualSpanOfTimes(scan->time_s);
  const double origin_s = BeyondASweep(span) ? span.low_s : 0.0;
  const double scale = longer(span) ? period_s / span.length_s() : 1.0;
  for (float& t : scan->time_s) t = static_cast<float>(scale * (static_cast<double>(t) - origin_s));
}

}  // namespace

Scan ReadStampedScan(const std::string& path, StampNs stamp_ns, bool recorded_stamp,
                     const ScanSourceOptions& options) {
  Scan scan = ReadScanFile(path, options.point_time_unit);
  GiveStamp(stamp_ns, recorded_stamp, &scan);
  if (!recorded_stamp) FitMadeUpStamp(options.frame_period_s, &scan);
  return scan;
}

void GiveStamp(StampNs stamp_ns, bool recorded_stamp, Scan* scan) {
  const StampNs clock_ns = scan->stamp_ns;
  scan->stamp_ns = stamp_ns;
  scan->stamp_made_up = !recorded_stamp;
  // The difference in double first: that of int64 might not fit.
  const double apart_ns = static_cast<double>(clock_ns) - static_cast<double>(stamp_ns);
  if (clock_ns != 0 && recorded_stamp && std::abs(apart_ns) <= kSameClockNs) {
    const float shift_s = static_cast<float>(SecondsBetween(stamp_ns, clock_ns));
    for (float& t : scan->time_s) t += shift_s;
  } else if (clock_ns == 0 && recorded_stamp) {
    FitClockNearZero(stamp_ns, scan);
  }
}

std::optional<SE3> ReadKittiCalibration(const std::string& path) {
  const std::string text = ReadFile(path);
  LineReader lines(path, text);
  while (lines.Next()) {
    const auto words = lines.Words();
    if (words[0] != "Tr:") continue;
    std::vector<double> numbers;
    for (std::size_t i = 1; i < words.size(); ++i) {
      if (!ParseNumber(words[i], &numbers.emplace_back())) lines.Fail("Tr: must have 12 numbers");
    }
    return PoseFromRowMajor(numbers, lines);
  }
  return std::nullopt;
}

}  // namespace lamina
