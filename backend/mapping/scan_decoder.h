// From a file to clusters: read, filter, cluster. The part of mapping that each scan goes through
// on its own, whatever comes after.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/scan.h"
#include "core/options/options.h"
#include "frontend/scan_preparation.h"
#include "io/recording/scan_source.h"

namespace lamina {

struct PipelineOptions {
  // Scans that may be under way at once.
  int lookahead_scans = 4;
  // A scan with fewer usable points is skipped.
  int min_points = 100;
  // Recordings (folders of an inbox) that are mapped at once. When one more comes, the one that was
  // silent longest is ended.
  int max_recordings = 8;

  void Visit(OptionVisitor& v);
};

// Why a scan got no pose of its own.
enum class SkipReason {
  kUnreadable,
  kTooFewPoints,
  kStampNotAfterLast,
  kNoRoomForPiece,
  kTooSoonAfterOtherSensor,  // of its vehicle (io/recording/vehicle_scans.h)
};
const char* ToString(SkipReason reason);

struct ScanDecodeReport {
  std::size_t index = 0;  // in the source
  std::string recording;  // that it is of (ScanSource::Recording), and its sensor there
  std::string sensor;
  StampNs stamp_ns = 0;
  bool stamp_made_up = false;  // Scan::stamp_made_up
  bool skipped = false;
  SkipReason reason = SkipReason::kUnreadable;
  std::string detail;      // of a skip, for a log line
  std::size_t points = 0;  // usable ones
  std::size_t clusters = 0;
  double read_ms = 0, prepare_ms = 0, cluster_ms = 0;  // wall time
};

struct DecodedScan {
  ScanDecodeReport report;
  std::vector<TimedCluster> clusters;  // empty if the scan was skipped
  std::vector<TimedPoint> points;      // usable ones, as prepared
};

// Scan i of a range that begins at `begin` (the period of a sweep is taken from stamps in it, of
// the same recording). A scan that cannot be used is a report, not an exception. Thread-safe.
DecodedScan DecodeScan(const ScanSource& source, const ScanPreparationOptions& preparation,
                       int min_points, double leaf_size_m, std::size_t begin, std::size_t i);

}  // namespace lamina
