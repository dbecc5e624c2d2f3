// A generated drive as a finished map, and windows of other drives that are localised in it without
// a start.
//
// A window is some seconds of scans from a random moment of the visiting drive, as recorded or in
// reverse order, by a sensor that is turned on its carrier by any angle about its vertical axis and
// leans a little; its frame is that of its first scan. Nothing tells where it is. It is a window
//
//     on the map     every scan is near a place where the map's sensor was
//     off the map    of the same scene, every scan is far from all of them
//     elsewhere      from a scene of another seed
//
// Or the sensor is lost while it maps: each window follows on the drive, or on the window before,
// after half a minute of darkness, in which it was carried there. To be matched to what was mapped
// before, without a look, is a claim as well.
//
// A claim is right if the last scan's pose in the map is within kRightM and kRightDeg of the truth,
// as the map has it there: moved by what a keyframe of the map nearby is off by itself.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "backend/localisation/place_report.h"
#include "tools/localise/cases.h"

namespace lamina {

inline constexpr double kRightM = 0.5, kRightDeg = 5.0;

enum class WindowKind { kOnMap, kOffMap, kElsewhere };
const char* ToString(WindowKind kind);

// A pose that a look compared.
struct ComparedPose {
  double after_s = 0.0;
  double error_m = 0.0, error_deg = 0.0;
  PlaceCandidate candidate;
};

struct WindowResult {
  WindowKind kind = WindowKind::kOnMap;
  std::size_t first_scan = 0;  // of the visiting drive
  bool reversed = false;
  double yaw_deg = 0.0, tilt_deg = 0.0;  // of the sensor on its carrier
  bool claimed = false, right = false;
  double after_s = 0.0;  // from the first scan to the claim
  double error_m = 0.0, error_deg = 0.0;
  // What each look ended with, and the farthest that the right pose came: see StageOf.
  std::vector<std::string> reasons;
  std::string stage;
  std::vector<ComparedPose> compared;
  double way_m = 0.0;  // of the sensor in the window
};

struct LocalisationTrial {
  std::string name;
  int seed = 0;
  std::size_t places = 0, pieces = 0;
  double map_error_m = 0.0;  // of its keyframes, root mean square, best fit
  std::vector<WindowResult> windows;
};

struct LocalisationTrialOptions {
  int on_map = 20, off_map = 4, elsewhere = 4;
  double window_s = 6.0;
  std::vector<std::string> set;  // key=value of the configuration, on top of the case's
  // The map is not finished: the windows are of the recording that makes it, each after darkness.
  bool lost = false;
};

// Deterministic. Throws OptionError.
LocalisationTrial RunLocalisationTrial(const LocalisationCase& place, int seed,
                                       const LocalisationTrialOptions& options);

}  // namespace lamina
