// One file of points as a scan, by the ending of its name, in upper or lower case: `.las`, `.LAS`.
//
// The formats stand in one table, in scan_file.cc: a row says which names are theirs, whether such
// files are the scans of a folder, who reads them and how their length is checked.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "core/geometry/scan_source.h"
#include "io/points/point_times.h"

namespace lamina {

// What a file in a folder is by its name alone. Hidden names (leading dot) are none; so are names
// with another ending, which writers use while they write (.partial, .tmp, .part).
enum class ScanName {
  kNone,
  kPoints,  // a scan of its folder: most formats
  kText     // .txt: a scan where the layout has such scans (KITTI raw) and none of other formats
};
ScanName KindOfName(std::string_view name);

// The files in `folder` whose names are of this kind, in natural order. Throws InputError if it is
// missing or cannot be read.
std::vector<std::filesystem::path> ListScans(const std::filesystem::path& folder, ScanName kind);

// Whether ReadScanFile reads a file of this name: those of folders, and formats that are read where
// they are named or listed by a layout of their own (.csv). Hidden names are none.
bool IsScanFile(const std::string& path);

// The endings of such names, for people: ".bin, .pcd, ... or .txt".
std::string ScanEndings();
// Those of folders of points: "*.bin, *.pcd, ...".
std::string FolderPatterns();

// stamp_ns of the result is 0 unless the file itself carries per-point readings of a clock (times
// more than 60 s from zero): then it is the earliest of them. Throws InputError. `times`, if not
// null, becomes what was understood of the points' times.
Scan ReadScanFile(const std::string& path, PointTimeUnit unit, PointTimeField* times = nullptr);

// Whether a file of points of `size` bytes, of which it is not known whether it is still written,
// holds what its format says it does: a .bin whole points, others the data that their header
// declares. True also for files that no further bytes will heal: their reader says what is wrong.
bool IsWholeScanFile(const std::string& path, std::uint64_t size);

}  // namespace lamina
