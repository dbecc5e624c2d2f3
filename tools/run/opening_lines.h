// What a run understood of its recording, in three lines before it begins: how scans are read and
// what their stamps are, what the times of the points are and do, what the sensor looks like and
// which configuration holds. What contradicts is told apart from that.
#pragma once

#include <string>
#include <vector>

#include "backend/opening/deskew_choice.h"
#include "backend/opening/sweep_choice.h"
#include "config/config.h"
#include "io/recording/scan_source.h"
#include "tools/cli/common.h"
#include "tools/run/fitting_config.h"

namespace lamina {

struct OpeningLines {
  // Three; of scans that cannot be read, or hold no finite point, those that tell something.
  std::vector<std::string> lines;
  std::vector<std::string> doubts;  // what contradicts, each with what to do
  // The first scans hold points that mapping takes.
  bool usable = true;
};

// `given` is what --config gave, empty for none; then a measured `fit` is taken to be in `config`.
// Reads the first readable of a few scans.
OpeningLines DescribeOpening(const ScanSource& source, const FrameRange& range,
                             const LaminaConfig& config, const FittingConfig& fit,
                             const std::string& given);

// What speaks against deskewing by the points' times, of a choice that is not to.
std::string DescribeAgainstDeskewing(const DeskewChoice& choice);

// What speaks for deskewing by azimuth, and the options that say so.
std::string DescribeSweep(const SweepChoice& choice);

}  // namespace lamina
