// One scan in, one pose out: predict, deskew, match.
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "core/options.h"
#include "core/scan.h"
#include "core/state_archive.h"
#include "core/voxel_map.h"
#include "frontend/scan_clusters.h"
#include "frontend/scan_matcher.h"

namespace lamina {

// Search over rotations about the prediction, for sensors that turn faster than matching alone can
// follow (hand-held, narrow view): hypotheses on a grid of rotation vectors are scored on the map's
// planes, a hash look-up for each cluster, and the best are refined by matching. A sensor that is
// put into a finished map is searched for over positions in the same way.
struct PoseSearchOptions {
  bool enabled = true;
  // Started when match and prediction differ by more than this, or ...
  double trigger_rotation_deg = 2.0;
  double trigger_translation_m = 0.5;
  // ... the share of inliers is below this part of its recent median.
  double trigger_inlier_ratio = 0.7;
  // The grid: -range, ..., -step, 0, step, ..., range about each axis.
  double range_deg = 15.0;
  double step_deg = 5.0;
  // Clusters scored for each hypothesis, at most, and the scale of the score.
  int clusters = 400;
  double score_scale_m = 0.2;
  // Hypotheses refined by matching.
  int refined = 6;
  // In a map that is there already, while no speed is known: offsets along x and y of the sensor,
  // too, -range, ..., range, as the turns above.
  double range_m = 3.0;
  double step_m = 0.5;

  void Visit(OptionVisitor& v);
};

struct OdometryOptions {
  // Deskew and match again so often with the motion just found.
  int deskew_passes = 1;
  // A gap longer than this leaves nothing of the old velocity: the prediction is to stand still.
  double max_prediction_gap_s = 1.0;
  // Lost when, after a search too, the share of inliers is below this part of its recent median.
  double lost_inlier_ratio = 0.35;
  ScanMatcherOptions matcher;
  PoseSearchOptions search;

  void Visit(OptionVisitor& v);
};

struct OdometryFrame {
  enum class Status {
    kFirst,  // nothing to match against yet: the pose is the start
    kTracked,
    kLost,  // no match to be trusted: the pose is the prediction, and must not enter a map
  };
  Status status = Status::kFirst;
  StampNs stamp_ns = 0;
  SE3 T_world_lidar;
  SE3 T_world_predicted;
  Vector6d twist = Vector6d::Zero();  // body, per second, during the scan
  MatchResult match;
  bool searched = false;  // a search ran
};

// Not thread-safe; deterministic.
class Odometry {
 public:
  explicit Odometry(const OdometryOptions& options);

  // Where a scan is expected, from the state alone.
  SE3 Predict(StampNs stamp_ns) const;
  // Pose of a scan from the state and the map. The state stays as it is until Accept. In a map that
  // is older than the drive, one that knows no speed yet is searched for about the prediction: a
  // street looks much the same a metre on, and a match settles where it begins.
  OdometryFrame Register(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                         const VoxelMap& map, bool map_is_older = false) const;

  // Makes a frame the last one: the next prediction starts from it. Not for lost frames, unless
  // mapping is to start anew from there.
  void Accept(const OdometryFrame& frame);
  // The last pose moves: T -> correction * T.
  void Correct(const SE3& correction);
  // The next scan is of another recording: nothing is known of the time in between.
  void Interrupt() { interrupted_ = true; }
  // Makes this pose the last one: the next scan is expected there.
  void StartAt(const SE3& T_world_lidar);

  void Archive(StateArchive& a);

  // Whether there is a last pose.
  bool started() const { return started_; }
  const Vector6d& velocity() const { return velocity_; }

 private:
  // Seconds since the last scan, if the velocity is still worth something.
  std::optional<double> KnownGap(StampNs stamp_ns) const;
  double RecentInliers() const;
  bool NeedsSearch(const OdometryFrame& frame) const;
  std::vector<SE3> TurnsAbout(const std::vector<SE3>& centres) const;
  std::vector<SE3> OffsetsAbout(const SE3& centre) const;
  // The best of the matches from the hypotheses and the given one.
  MatchResult Search(const std::vector<PointCluster>& clusters, const std::vector<SE3>& hypotheses,
                     const MatchResult& given, const VoxelMap& map) const;

  OdometryOptions options_;
  ScanMatcher matcher_;
  std::deque<double> recent_inliers_;
  bool started_ = false, interrupted_ = false;
  StampNs last_stamp_ns_ = 0;
  SE3 T_world_last_;
  Vector6d velocity_ = Vector6d::Zero();
};

}  // namespace lamina
