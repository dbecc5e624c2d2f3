// What speaks against a scan, a motion or a run: the limits of `lamina run`'s verdict
// (tools/results/verdict/verdict.h) and of `lamina doctor` (weak_places.h), in one place.
//
// All of them are absolute, none is taken from the run's own median: a sensor that was lost from
// the first scan on is steadily so. The thickness of the map is none of them: a run that is stuck
// in one place has the thinnest map.
//
//   measure of a run                                               doubtful      wrong
//   ------------------------------------------------------------------------------------
//   matches that did not converge, of those matched                    8 %       15 %
//   median share of inliers                                           0.30       0.20
//   median fit of what meets planes at all                            0.75       0.60
//   frames that are lost                                               5 %       50 %
//   scans that are skipped, of all (but those too soon after another
//   sensor's of the vehicle)                                           5 %       50 %
//   motions that no vehicle makes: more than 30 m/s^2                  1 %        4 %
//   frames with a direction that nothing determines                   25 %        -
//   pieces that no match connects                                        2        -
//
// Seen in generated scenes with exact truth (lamina adverse): runs that are right have up to 3 %
// that do not converge, 0.39 of inliers or more, a fit of 0.86 or more, and 1 % of such motions;
// runs that slip have 4 to 25 % of them.
//
// A single scan is weak where it is as bad as would make the whole run wrong.
#pragma once

#include <optional>

#include "core/geometry/scan.h"
#include "io/store/scan_record.h"

namespace lamina::run_rules {

struct Limit {
  double doubtful, wrong;
};

// Shares, see above.
inline constexpr Limit kUnconverged{0.08, 0.15};
inline constexpr Limit kInliers{0.30, 0.20};
inline constexpr Limit kFit{0.75, 0.60};
inline constexpr Limit kLost{0.05, 0.50};
inline constexpr Limit kSkipped{0.05, 0.50};
inline constexpr Limit kJumps{0.01, 0.04};
inline constexpr double kDegenerate = 0.25;

// Beyond what brakes, tyres and arms can do ...
inline constexpr double kMostM_S2 = 30.0;
inline constexpr double kMostDeg_S2 = 3000.0;
// ... and the error that a pose may have, which two scans a short time apart make an acceleration.
inline constexpr double kPoseErrorM = 0.05;
inline constexpr double kPoseErrorDeg = 0.5;

// Root mean square distance of a scan to its planes, in standard deviations of the range noise
// (map.noise_floor_m): 1.5 to 3 where poses are right, in streets, rooms and woods.
inline constexpr double kMostResidualFloors = 5.0;

// An interval between stamps longer than so many usual ones of the recording: a scan is missing.
inline constexpr double kGapPeriods = 1.5;
// The same where intervals are uneven, as between keyframes.
inline constexpr double kUnevenGapPeriods = 5.0;

// Time in s that mapping falls behind the sensor at a place where it takes longer than the scans
// are apart: less is made up for unnoticed.
inline constexpr double kMostBehindS = 1.0;

// Whether its pose is of its own points.
inline bool IsLost(const ScanRecord& scan) { return !scan.skipped && scan.status == "lost"; }
inline bool IsDegenerate(const ScanRecord& scan) { return scan.status == "degenerate"; }
inline bool IsMatched(const ScanRecord& scan) {
  return !scan.skipped && !IsLost(scan) && scan.matched > 0;
}

// max_iterations: of the matcher.
inline bool IsUnconverged(const ScanRecord& scan, int max_iterations) {
  return IsMatched(scan) && scan.iterations >= max_iterations;
}

// Share of the clusters that meet planes, and of the kernel's weights among those.
double Overlap(const ScanRecord& scan);
double Fit(const ScanRecord& scan);

// Acceleration between three poses that follow one another, less what errors of the poses may make
// of it.
struct MotionChange {
  double m_s2 = 0.0, deg_s2 = 0.0;
};

// Nothing if stamps do not grow.
std::optional<MotionChange> ChangeOfMotion(const StampedPose& first, const StampedPose& second,
                                           const StampedPose& third);

}  // namespace lamina::run_rules
