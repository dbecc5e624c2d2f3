// LAS files (ASPRS, versions 1.0 to 1.4, point formats 0 to 10) as scans, and LAZ files, COPC among
// them, of point formats 0 to 3 and 6 to 10.
//
// One file is one scan, in the frame of its sensor. Its points are not split by their times: files
// that hold more than a sweep are in the frame of a map, where there is nothing left to match.
// Points that are flagged as withheld are left out.
//
// Private to io/points.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "core/geometry/scan_source.h"
#include "io/points/point_times.h"

namespace lamina {

// Times are those of GPS, in seconds, where the format has them, whatever `unit`: readings of a
// clock. Throws InputError naming file and rule: a header that contradicts itself or the file's
// length, points that are compressed in another way, coordinates that are those of a map (all more
// than 10 km from the origin), no points.
Scan ReadLas(const std::string& path, PointTimeUnit unit, PointTimeField* times);

// How long a file must be, at least, by its first bytes: of LAS header and points, of LAZ all to
// the table of its chunks, or more than any where that has no place yet. Nothing if what tells does
// not end within `head`; 0 if the header breaks a rule.
std::optional<std::size_t> DeclaredLasBytes(std::string_view head);

}  // namespace lamina
