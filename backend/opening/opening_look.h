// The map of a few scans under one way of understanding the times of their points: what choices
// between such ways compare (deskew_choice.h, sweep_choice.h).
//
// Private to backend/opening.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <optional>
#include <utility>

#include "backend/mapping/options.h"
#include "backend/opening/map_thickness.h"
#include "core/geometry/scan_source.h"

namespace lamina {

// So many scans are looked at.
inline constexpr std::size_t kLookScans = 20;

// Of the thickness of a map, below which another one is clearly thinner: differences of fewer per
// cent are within what maps of so few scans vary by.
inline constexpr double kClearlyThinner = 0.9;

struct OpeningLook {
  bool tracked = false;     // throughout
  bool determined = false;  // MappingCounts::MostlyDetermined
  double lost_share = 0.0;  // of the scans
  double way_m = 0.0, turn_rad = 0.0;
  Vector6d start_velocity = Vector6d::Zero();  // of the first scan, in the body, per second
  Trajectory poses;                            // at the scans' stamps
  MapThickness map;

  // Whether its map tells anything: the sensor moved, and there are planes.
  bool Tells() const;
  bool HasPlanes() const;
  // Whether poses and map are known, moved or not.
  bool IsSure() const;
};

// Maps scans [begin, end) without loops, with what options.mapper knows of the start.
OpeningLook LookAt(const ScanSource& source, std::size_t begin, std::size_t end,
                   const ScanPreparationOptions& preparation, MappingOptions options,
                   const std::atomic<bool>* stop);

// Whether scans are lost by their times alone. At a start at speed some are lost by right times as
// well, and distorted ones tracked, all bent alike: planes that are as thin by the times speak for
// these, and where most scans are lost, planes that are clearly thinner.
bool Misled(const OpeningLook& deskewed, const OpeningLook& as_they_are);

// Whether the maps of both say anything: the sensor moved, and both found much the same.
bool Comparable(const OpeningLook& a, const OpeningLook& b);

// The looks under both: at the first scans, or, where `tells` says that these tell nothing, at some
// from the middle. Nothing if neither tells, or if it was stopped.
using TellsOfBoth = std::function<bool(const OpeningLook& one, const OpeningLook& other)>;
std::optional<std::pair<OpeningLook, OpeningLook>> LookUnderBoth(
    const ScanSource& source, std::size_t begin, std::size_t end, const MappingOptions& options,
    const ScanPreparationOptions& one, const ScanPreparationOptions& other,
    const TellsOfBoth& tells, const std::atomic<bool>* stop);

// Between the first scans of a sensor; 0 where their stamps tell none.
double PeriodByStamps(const ScanSource& source, std::size_t begin, std::size_t end);

// How the times of the points lie between the stamps, by the first scan that can be read.
enum class PointTimes { kUnknown, kNone, kOfTheScan, kLonger };
PointTimes PointTimesOf(const ScanSource& source, std::size_t begin, std::size_t end);

}  // namespace lamina
