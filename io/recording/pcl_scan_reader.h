// PCD and PLY files, read by PCL. Private to io; the one door through which PCL comes in.
#pragma once

#include <string>

#include "core/geometry/scan.h"
#include "io/recording/scan_source.h"

namespace lamina {

// Fields and times as in io/message/point_cloud.h. Throw InputError, also for a file of no points.
// `times` may be null, as for ReadScanFile.
Scan ReadPcd(const std::string& path, const ScanSourceOptions& options, PointTimeField* times);
Scan ReadPly(const std::string& path, const ScanSourceOptions& options, PointTimeField* times);

}  // namespace lamina
