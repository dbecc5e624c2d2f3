// What became of a scan: the one record of it, begun when its points are read and complete when it
// has its place in the map.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "core/geometry/scan.h"
#include "frontend/odometry/odometry_frame.h"

namespace lamina {

// Why a scan got no pose of its own.
enum class SkipReason {
  kUnreadable,
  kTooFewPoints,
  kStampNotAfterLast,
  kNoRoomForPiece,
  kTooSoonAfterOtherSensor,  // of its vehicle
};
const char* ToString(SkipReason reason);

struct MappedScan {
  std::size_t index = 0;  // in its source; increases from scan to scan
  std::string recording;  // that it is of (ScanSource::Recording), and its sensor there
  std::string sensor;
  StampNs stamp_ns = 0;
  bool stamp_made_up = false;  // Scan::stamp_made_up
  bool skipped = false;
  SkipReason reason = SkipReason::kUnreadable;
  std::string detail;        // of a skip, for a log line
  std::size_t points = 0;    // usable ones
  std::size_t clusters = 0;  // that they make, one a voxel
  // Pose, covariance and figures of the match; meaningless for a skipped scan.
  OdometryFrame odometry;
  bool keyframe = false;
  std::int64_t piece = 0;    // of the map, in whose frame the pose is
  bool began_piece = false;  // with this scan
  // Transform from the frame of the pose, that of odometry, to that of the map as loops have
  // corrected it by now (backend/loops/loop_track.h); identity before any has. It may jump; the
  // pose does not.
  SE3 T_map_world;
  // Milliseconds of wall time. Of the solve: the one that was taken in before this scan. Of the
  // map: to take that in and to build the next problem, since the scan before.
  double read_ms = 0, prepare_ms = 0, cluster_ms = 0, odometry_ms = 0, map_ms = 0, solve_ms = 0;

  // `why` may have bytes of a file in it.
  void Skip(SkipReason skip_reason, const std::string& why);
};

// Status in a word, as in results: tracked, degenerate (tracked, and planes do not determine some
// direction, or not to OdometryOptions::max_tracked_sigma_m), first, lost, or the reason of a skip.
const char* StatusName(const MappedScan& scan);

}  // namespace lamina
