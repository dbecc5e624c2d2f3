// Per-point time fields of point files, which come in any unit and on any clock.
#pragma once

#include <string>
#include <vector>

#include "core/geometry/scan_source.h"

namespace lamina {

// Unit of a field of times. kAuto: the one that makes the scan last about as long as scans do.
enum class PointTimeUnit { kAuto, kSeconds, kMilliseconds, kMicroseconds, kNanoseconds };

struct PointTimes {
  // Time of the earliest point if the field has a clock of its own, else 0.
  StampNs stamp_ns = 0;
  // Seconds from stamp_ns for each point; empty if the field tells nothing.
  std::vector<float> time_s;
  // That the field was taken to have: s, ms, us or ns; empty if it tells nothing.
  const char* unit = "";
};

// Unit: as given, or for kAuto the one out of s, ms, us, ns that fits how long a scan lasts: among
// those under which the span from the earliest to the latest point is 1 ms .. 10 s, a unit under
// which the field counts from the Unix epoch (2001 to 2065), else the one that brings the span
// nearest to 0.1 s in ratio. A span of 0.1 s is 0.1, 100, 1e5 or 1e8, so real scans are clear;
// where no unit fits, InputError asks for the option.
//
// Clock: times that come within 1 s of zero are offsets from the file's stamp and stay as they are.
// Any others (Unix epoch, time since boot, GPS time of week) are readings of a clock: stamp_ns is
// the earliest, and time_s counts from there.
//
// The field tells nothing if all its values are the same (drivers write zeros; the stamp of a clock
// is kept) or if it is float32 too coarse for its span (epoch seconds in a float32 step by 128 s).
//
// A hundredth of the values may be damaged: one that is farther from all others than their span,
// and than 0.25 s, gets the time NaN, and what the field means is decided without it. Values that
// are not finite get time 0. `field` names file and field in errors. T: float, double,
// std::uint32_t, std::int64_t or std::uint64_t.
template <typename T>
PointTimes ConvertPointTimes(const std::vector<T>& raw, PointTimeUnit unit,
                             const std::string& field);

}  // namespace lamina
