// PCD and PLY files as scans.
//
// Headers and, for ASCII, every word are held against the file's bytes first
// (io/points/point_file_check.h); what fields mean is for io/points/point_cloud.h.
//
// Private to io/points.
#pragma once

#include <string>

#include "core/geometry/scan_source.h"
#include "io/points/point_times.h"

namespace lamina {

// Any set of fields, as ScanFromCloud has it. Throw InputError, also for a file of no points.
// `times` may be null, as for ReadScanFile.
Scan ReadPcd(const std::string& path, PointTimeUnit unit, PointTimeField* times);
Scan ReadPly(const std::string& path, PointTimeUnit unit, PointTimeField* times);

}  // namespace lamina
