// PCD and PLY files as scans.
//
// Headers and, for ASCII, every word are held against the file's bytes first
// (io/recording/point_file_check.h); what fields mean is for io/message/point_cloud.h.
//
// Private to io/recording.
#pragma once

#include <string>

#include "core/geometry/scan.h"
#include "io/recording/scan_source.h"

namespace lamina {

// Any set of fields, as ScanFromCloud has it. Throw InputError, also for a file of no points.
// `times` may be null, as for ReadScanFile.
Scan ReadPcd(const std::string& path, const ScanSourceOptions& options, PointTimeField* times);
Scan ReadPly(const std::string& path, const ScanSourceOptions& options, PointTimeField* times);

}  // namespace lamina
