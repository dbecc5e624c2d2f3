// Which of the shipped configurations a recording asks for, by what its scans look like.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "io/recording/scan_source.h"
#include "tools/cli/common.h"

namespace lamina {

// What a scan tells of the sensor that took it.
struct SensorGuess {
  std::size_t points = 0;
  int rings = 0;                           // 0: the points lie on none
  double lowest_deg = 0, highest_deg = 0;  // elevation, but for a few outliers
  double around_deg = 0;                   // horizontal field of view
  double mostly_m = 0;                     // nine points of ten are within it
  double far_share = 0;                    // of the directions around: something is beyond 15 m
  double farthest_m = 0;                   // but for a few outliers
};
SensorGuess GuessSensor(const std::vector<ScanPoint>& points);

struct FittingConfig {
  std::string name;    // of a shipped configuration; empty where the defaults fit
  std::string reason;  // why, for a line of text
  // The scans tell, so it is taken where none is given. Else a folder's name tells, which scans of
  // other sensors may have as well: it is recommended.
  bool measured = false;
};

// Looks at a few scans of all of the range; those that cannot be read tell nothing.
FittingConfig FindFittingConfig(const ScanSource& source, const FrameRange& range);

}  // namespace lamina
