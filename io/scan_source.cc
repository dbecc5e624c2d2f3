#include "io/scan_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <tuple>
#include <utility>
#include <vector>

#include "core/error.h"
#include "io/ethz_csv.h"
#include "io/scan_layout.h"
#include "io/scan_names.h"
#include "io/text_input.h"
#include "io/vehicle_scans.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// Stamps of the recording and of the points that are further apart come from different clocks.
constexpr double kSameClockNs = 10e9;

class FileScanSource final : public ScanSource {
 public:
  FileScanSource(const ScanLayout& layout, const ScanSourceOptions& options) : options_(options) {
    // Before all others: a cloud of reference may lie beside such scans.
    if (OpenEthz(layout.scans)) return;
    files_ = ListScans(layout.scans, ScanName::kPoints);
    if (files_.empty() && layout.text_scans) files_ = ListScans(layout.scans, ScanName::kText);
    if (files_.empty()) {
      throw InputError(fmt::format("{}: holds no scans (*.bin, *.pcd, *.ply, Hokuyo_*.csv{})",
                                   layout.scans.string(), layout.text_scans ? ", *.txt" : ""));
    }
    FindStamps(layout);
    if (MayExist(layout.calibration)) {
      T_camera_lidar_ = ReadKittiCalibration(layout.calibration.string()).value_or(SE3());
    }
  }

  std::size_t size() const override { return files_.size(); }
  std::string Name(std::size_t i) const override { return files_.at(i).string(); }
  StampNs Stamp(std::size_t i) const override { return stamps_.at(i); }
  bool recorded_stamps() const override { return recorded_stamps_; }
  SE3 T_camera_lidar() const override { return T_camera_lidar_; }

  Scan Read(std::size_t i) const override {
    return ReadStampedScan(Name(i), Stamp(i), recorded_stamps_, options_);
  }

 private:
  void FindStamps(const ScanLayout& layout) {
    if (MayExist(layout.stamps)) {
      stamps_ = ReadStamps(layout.stamps.string(), files_);
    } else {
      stamps_ = StampsFromNames(files_);
      SortByStamp();
    }
    MakeUpMissingStamps();
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

  // Stamps in names say the order better than the names do: 1.25 comes before 1.5.
  void SortByStamp() {
    if (stamps_.empty()) return;
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
  SE3 T_camera_lidar_;
};

}  // namespace

void ScanSourceOptions::Visit(OptionVisitor& v) {
  v.Number("frame_period_s", &frame_period_s, 1e-6, 1e6);
  v.EnumChoice("point_time_unit", &point_time_unit, {"auto", "s", "ms", "us", "ns"});
  constexpr double kMostM = 100.0;
  v.FolderPoses("T_vehicle_lidar", &T_vehicle_lidar, kMostM);
}

std::unique_ptr<ScanSource> OpenScans(const std::string& path, const ScanSourceOptions& options) {
  CheckOptions(options, "scans");
  if (!options.T_vehicle_lidar.empty()) return std::make_unique<VehicleScans>(path, options);
  return std::make_unique<FileScanSource>(FindScanLayout(path), options);
}

StampNs MadeUpStamp(std::size_t i, const ScanSourceOptions& options) {
  return std::llround(static_cast<double>(i) * options.frame_period_s * 1e9);
}

Scan ReadStampedScan(const std::string& path, StampNs stamp_ns, bool recorded_stamp,
                     const ScanSourceOptions& options) {
  Scan scan = ReadScanFile(path, options);
  const StampNs clock_ns = scan.stamp_ns;
  scan.stamp_ns = stamp_ns;
  // The difference in double first: that of int64 might not fit.
  const double apart_ns = static_cast<double>(clock_ns) - static_cast<double>(scan.stamp_ns);
  if (clock_ns != 0 && recorded_stamp && std::abs(apart_ns) <= kSameClockNs) {
    const float shift_s = static_cast<float>(SecondsBetween(scan.stamp_ns, clock_ns));
    for (float& t : scan.time_s) t += shift_s;
  }
  return scan;
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
