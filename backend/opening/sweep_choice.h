// How scans whose points carry no times were swept.
//
// Files of points alone do not tell whether the scans were compensated for the sensor's motion when
// they were made, or are sweeps of a spinning sensor as recorded: such a sweep at 10 m/s is torn by
// a metre where it begins and ends. Where the sensor moved, the wrong one of both bends what is
// plane, so the right one gives the thinner map (MeasureThickness).
#pragma once

#include <atomic>
#include <cstddef>

#include "backend/mapping/options.h"
#include "core/geometry/scan_source.h"

namespace lamina {

struct SweepChoice {
  bool swept = false;  // false: as they are, or nothing tells
  // Of a sweep, for ScanPreparationOptions::Deskew::kAzimuth.
  ScanPreparationOptions::Rotation rotation = ScanPreparationOptions::Rotation::kClockwise;
  double sweep_start_azimuth_deg = 0.0;
  // Thickness of the planes of the maps that were compared, metres: the geometric mean of
  // MapThickness::thin_m and median_m; 0 where nothing was compared.
  double by_azimuth_m = 0.0, as_they_are_m = 0.0;
};

// For scans [begin, end) of a recording of one sensor that sees all around: looks at the first
// ones and at some from the middle. One of both must tell that they were swept, and the other must
// not tell that they were not. Does not look at all unless options.preparation.deskew is kAuto and
// the points have no times.
SweepChoice ChooseSweep(const ScanSource& source, std::size_t begin, std::size_t end,
                        const MappingOptions& options, const std::atomic<bool>* stop);

// The options with what was chosen.
ScanPreparationOptions WithSweep(ScanPreparationOptions options, const SweepChoice& choice);

struct SweepPeriodChoice {
  double period_s = 0.0;  // of a sweep; 0: as stamps have it
  // Thickness of a quarter of the planes at most (MapThickness::thin_m), of the map of sweeps as
  // long as stamps have them, and half as long.
  double by_stamps_m = 0.0, halved_m = 0.0;
};

// Where azimuth gives the times of points, and stamps are more than 0.15 s apart, the sensor may
// have swept twice between them, as where every second scan was dropped. Looks as ChooseDeskew
// does (deskew_choice.h).
SweepPeriodChoice ChooseSweepPeriod(const ScanSource& source, std::size_t begin, std::size_t end,
                                    const MappingOptions& options, const std::atomic<bool>* stop);

}  // namespace lamina
