// What the scans of a recording decide of its configuration: which of the shipped ones holds, where
// none is named; and how scans are deskewed: those that are compensated already, or whose times
// mislead, are not; sweeps without times are, by azimuth.
#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "backend/opening/deskew_choice.h"
#include "backend/opening/sweep_choice.h"
#include "config/config.h"
#include "io/recording/scan_source.h"
#include "tools/cli/common.h"
#include "tools/run/fitting_config.h"

namespace lamina {

struct OpeningChoice {
  FittingConfig fit;
  DeskewChoice deskew;
  SweepChoice sweep;
  SweepPeriodChoice period;
  LaminaConfig config;  // with all of these

  // What is not as the scans seem to say, and what was chosen.
  std::vector<std::string> Warnings() const;
};

// A shipped configuration with what else was asked for. Throws OptionError.
using ShippedConfig = std::function<LaminaConfig(const std::string& name)>;

// Looks at scans of the range. `shipped` is empty where a configuration was named: then that stays.
OpeningChoice ChooseOpening(const ScanSource& source, const FrameRange& range,
                            const LaminaConfig& config, const ShippedConfig& shipped,
                            const std::atomic<bool>& stop);

}  // namespace lamina
