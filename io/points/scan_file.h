// One file of points as a scan, by the ending of its name.
#pragma once

#include <string>

#include "core/geometry/scan_source.h"
#include "io/points/point_times.h"

namespace lamina {

// Whether ReadScanFile reads a file of this name. Hidden names (leading dot) are none.
bool IsScanFile(const std::string& path);
// The endings of such names, for people.
inline constexpr const char* kScanEndings = ".bin, .pcd, .ply, .las, .laz, .csv or .txt";

// .bin, .pcd, .ply, .las, .laz or .csv (KITTI raw's .txt too). stamp_ns of the result is 0 unless
// the file itself carries per-point readings of a clock (times more than 60 s from zero): then it
// is the earliest of them. Throws InputError. `times`, if not null, becomes what was understood of
// the points' times.
Scan ReadScanFile(const std::string& path, PointTimeUnit unit, PointTimeField* times = nullptr);

}  // namespace lamina
