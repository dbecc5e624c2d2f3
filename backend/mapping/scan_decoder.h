// From points to clusters: read, filter, cluster. The part of mapping that each scan goes through
// on its own, whatever comes after, and on any thread.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "backend/mapping/mapped_scan.h"
#include "core/geometry/point_cluster.h"
#include "core/geometry/scan.h"
#include "core/geometry/scan_source.h"
#include "frontend/scan/scan_preparation.h"

namespace lamina {

struct DecodedScan {
  MappedScan report;                   // without what mapping adds
  std::vector<TimedCluster> clusters;  // empty if the scan was skipped
  std::vector<TimedPoint> points;      // usable ones, as prepared
};

// How many stamps, of the last scans up to this one, tell the period of a sweep (SweepPeriod; 0.1 s
// where they do not).
inline constexpr std::size_t kPeriodStamps = 11;

// Filters and clusters the points of a scan; one that cannot be used, also because the times of its
// points are no times of a sweep, is a report, not an exception. `name` is for messages.
// Thread-safe.
void ClusterScan(const Scan& scan, const std::string& name,
                 const ScanPreparationOptions& preparation, int min_points, double leaf_size_m,
                 const std::vector<StampNs>& stamps, const SE3& T_vehicle_lidar,
                 DecodedScan* decoded);

// Reads and clusters scan i of a range that begins at `begin` (the period of a sweep is taken from
// stamps in it, of the same recording). Thread-safe.
DecodedScan DecodeScan(const ScanSource& source, const ScanPreparationOptions& preparation,
                       int min_points, double leaf_size_m, std::size_t begin, std::size_t i);

}  // namespace lamina
