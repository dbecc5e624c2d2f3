// The layout of the ETHZ registration data set ("Challenging data sets for point cloud registration
// algorithms", Pomerleau et al., IJRR 2012).
//
//   Hokuyo_N.csv            a scan: a header that names the columns, then a line for each point
//   pose_scanner_leica.csv  a header, then a line for each scan: T00 ... T33, row-major, p_world =
//                           T p_scanner, and perhaps a timestamp in seconds
//
// Columns are parted by commas or semicolons, whichever the header has, and found by their names:
// case, blanks and quotes make no difference, other columns are passed over. The scanner stood
// still: points are without time.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "io/points/point_times.h"

namespace lamina {

// Hokuyo_*.csv in the folder, in natural order; may be empty.
std::vector<std::filesystem::path> ListHokuyoFiles(const std::filesystem::path& folder);

// Columns x, y, z, and intensity or intensities if there is one; no times. Throws InputError with
// file and line: no header, a column missing, a word that is no number, no points.
Scan ReadHokuyoCsv(const std::string& path, PointTimeUnit unit, PointTimeField* times);

// Poses whose stamps are those of the file if they increase; `has_stamps` tells. Without: 0, 1, ...
// Throws InputError as ReadTrajectory does.
Trajectory ReadLeicaPoses(const std::string& path, bool* has_stamps);

}  // namespace lamina
