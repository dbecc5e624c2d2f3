// The record of a scan with which nothing is wrong.
#pragma once

#include "io/store/scan_record.h"

namespace lamina {

// Of a drive at 10 m/s.
inline ScanRecord GoodScan(int i) {
  ScanRecord scan;
  scan.scan = i;
  scan.stamp_ns = 100'000'000LL * i;
  scan.recorded_stamp = true;
  scan.status = i == 0 ? "first" : "tracked";
  scan.T_world_lidar.t.x() = 1.0 * i;
  scan.clusters = 1000;
  scan.matched = i == 0 ? 0 : 800;
  scan.inlier_share = 0.75;
  scan.iterations = 6;
  return scan;
}

}  // namespace lamina
