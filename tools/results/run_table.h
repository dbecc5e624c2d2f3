// What a finished run or session has left in its folder, scan by scan: frames.csv with the poses of
// trajectory_tum.txt, summary.json and config.yaml. Older runs lack some of it: what is not there,
// or cannot be used, is told in `notes`.
#pragma once

#include <cstddef>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "config/config.h"
#include "io/store/scan_record.h"

namespace lamina {

// In the place of a figure that is not there.
inline constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

struct RunScan {
  // Figures that the table lacks are 0, or NaN where 0 would mean something: inlier_share,
  // residual_m, worst_sigma_m. `sequence` is the recording and recorded_stamp that of
  // its piece, by summary.json.
  // Of pieces that were joined, that in whose frame the pose is.
  ScanRecord record;
  bool has_stamp = false, has_pose = false;
  // The piece in whose frame the pose is; nothing without the column.
  std::optional<std::int64_t> frame;
  // Length of the way from the first scan of its piece, in metres; NaN where no pose is known.
  double way_m = kUnknown;
  // Since the newest stamp of its recording before; NaN if there is none.
  double interval_s = kUnknown;
};

struct RunTable {
  std::string folder;
  std::vector<RunScan> scans;  // in order; one at least
  LaminaConfig config;         // of the run, the default one if config.yaml is missing
  nlohmann::json summary = nlohmann::json::object();
  std::vector<std::string> notes;
};

// Throws InputError: no such folder, no frames.csv, one that does not name the columns scan and
// status, one without any usable line; a summary.json that is none. Lines that
// are cut short or hold what is no number are left out and counted.
RunTable ReadRunTable(const std::string& folder);

// Where the rows of a scan's recording are usually apart, s; NaN if stamps do not tell. With
// several sensors on one vehicle, whose scans come in bursts, the longer of these intervals.
double UsualInterval(const RunTable& table, const std::string& sequence);
// Whether most of a recording's intervals are like the usual one; those of keyframes are not.
bool HasEvenIntervals(const RunTable& table, const std::string& sequence);

}  // namespace lamina
