// What a run understood of its recording, in three lines before it begins: how scans are read and
// what their stamps are, what the times of the points are and do, what the sensor looks like and
// which configuration holds. What contradicts is told apart from that.
#pragma once

#include <string>
#include <vector>

#include "backend/mapping/deskew_choice.h"
#include "config/config.h"
#include "io/recording/scan_source.h"
#include "tools/cli/common.h"

namespace lamina {

// What a scan tells of the sensor that took it.
struct SensorGuess {
  std::size_t points = 0;
  int rings = 0;                           // 0: the points lie on none
  double lowest_deg = 0, highest_deg = 0;  // elevation, but for a few outliers
  double around_deg = 0;                   // horizontal field of view
  double farthest_m = 0;                   // but for a few outliers
};
SensorGuess GuessSensor(const std::vector<ScanPoint>& points);

struct OpeningLines {
  // Three; of scans that cannot be read, or hold no finite point, those that tell something.
  std::vector<std::string> lines;
  std::vector<std::string> doubts;  // what contradicts, each with what to do
  // The shipped configuration that is for such a recording; empty if there is none.
  std::string fitting_config;
  // The first scans hold points that mapping takes.
  bool usable = true;
};

// `config_name` is what --config gave; empty for none. Reads the first readable of a few
// scans.
OpeningLines DescribeOpening(const ScanSource& source, const FrameRange& range,
                             const LaminaConfig& config, const std::string& config_name);

// What speaks against deskewing by the points' times, of a choice that is not to.
std::string DescribeAgainstDeskewing(const DeskewChoice& choice);

}  // namespace lamina
