// PCD and PLY files, read by PCL. Private to io; the one door through which PCL comes in.
#pragma once

#include <string>

#include "core/geometry/scan.h"
#include "io/recording/scan_source.h"

namespace lamina {

// Any set of fields with x, y and z (float or double). Taken up as well, if they are there:
// intensity, reflectivity or i, of any type; and a time of each point: t, time, timestamp,
// offset_time, time_offset, point_time_offset or ts, of any type, see io/recording/point_times.h.
// Upper case and a leading `scalar_` (CloudCompare) make no difference. Throw InputError, also for
// a file of no points. `times` may be null, as for ReadScanFile.
Scan ReadPcd(const std::string& path, const ScanSourceOptions& options, PointTimeField* times);
Scan ReadPly(const std::string& path, const ScanSourceOptions& options, PointTimeField* times);

}  // namespace lamina
