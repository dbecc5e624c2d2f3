// One scan in, one pose out: predict, deskew, match.
#pragma once

#include <vector>

#include "core/options.h"
#include "core/scan.h"
#include "core/voxel_map.h"
#include "frontend/scan_clusters.h"
#include "frontend/scan_matcher.h"

namespace lamina {

struct OdometryOptions {
  // Deskew and match again so often with the motion just found.
  int deskew_passes = 1;
  // A gap longer than this leaves nothing of the old velocity: the prediction is to stand still.
  double max_prediction_gap_s = 1.0;
  ScanMatcherOptions matcher;

  void Visit(OptionVisitor& v);
};

struct OdometryFrame {
  StampNs stamp_ns = 0;
  SE3 T_world_lidar;
  SE3 T_world_predicted;
  Vector6d twist = Vector6d::Zero();  // body, per second, during the scan
  MatchResult match;
};

// Not thread-safe; deterministic.
class Odometry {
 public:
  explicit Odometry(const OdometryOptions& options);

  // Pose of a scan from the state and the map. The state stays as it is until Accept.
  OdometryFrame Register(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                         const VoxelMap& map) const;

  // Makes a frame the last one: the next prediction starts from it.
  void Accept(StampNs stamp_ns, const SE3& T_world_lidar);
  // The last pose moves: T -> correction * T.
  void Correct(const SE3& correction);

  const Vector6d& velocity() const { return velocity_; }

 private:
  OdometryOptions options_;
  ScanMatcher matcher_;
  int accepted_ = 0;
  StampNs last_stamp_ns_ = 0;
  SE3 T_world_last_;
  Vector6d velocity_ = Vector6d::Zero();
};

}  // namespace lamina
