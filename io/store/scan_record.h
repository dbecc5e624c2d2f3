// What became of a scan, as it is written down: a line of frames.csv, a row of a session's
// database.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "core/geometry/scan.h"

namespace lamina {

struct ScanRecord {
  std::int64_t scan = 0;  // its number, from 0
  std::string file;       // its identity: the name in the inbox
  std::string sequence;
  StampNs stamp_ns = 0;
  bool recorded_stamp = false;
  std::optional<StampNs> next_stamp_ns;  // of the first scan of a sequence (InboxFile)
  std::int64_t piece = 0;                // of the map, in whose frame the pose is
  bool skipped = false;                  // the pose is not of its own points
  bool final = false;                    // nothing will change the pose any more
  SE3 T_world_lidar;

  std::string status;  // tracked, first, lost, degenerate, or why it was skipped
  std::string detail;  // of a skip
  bool keyframe = false, searched = false;
  std::int64_t points = 0, clusters = 0, matched = 0, iterations = 0, unobservable_directions = 0;
  double inlier_share = 0.0, residual_m = 0.0;
  // Standard deviation along the direction that is known least: by planes alone, or, if that is
  // more, by the covariance.
  double worst_sigma_m = 0.0;
  Matrix6d covariance = Matrix6d::Zero();
  double read_ms = 0, prepare_ms = 0, cluster_ms = 0, odometry_ms = 0, map_ms = 0, solve_ms = 0;

  // It was of a start that was given up later: no motion explains its scans, so that the direction
  // of motion is not determined.
  void GiveUp() {
    if (status != "tracked") return;
    status = "degenerate";
    unobservable_directions = 1;
  }
};

}  // namespace lamina
