// Points as the KITTI data sets write them, four numbers each, x y z intensity, without times; and
// as nuScenes does, with the number of the ring as a fifth.
//
// Private to io/points.
#pragma once

#include <cstddef>
#include <string>

#include "core/geometry/scan.h"
#include "io/points/point_times.h"

namespace lamina {

// Whether a `.bin` of this length holds whole records.
bool IsWholeKittiBin(std::size_t bytes);

// `.bin`: float32, little-endian, no header: a record has five numbers where its length allows it
// and every fifth number is a whole one below 256. `.txt`: a line for each point. Unit and times,
// which every reader of points takes, have no meaning here. Throw InputError naming file and, for
// text, line; also for a file of no points.
Scan ReadKittiBin(const std::string& path, PointTimeUnit unit, PointTimeField* times);
Scan ReadKittiText(const std::string& path, PointTimeUnit unit, PointTimeField* times);

}  // namespace lamina
