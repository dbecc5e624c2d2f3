// The track of a lost sensor: scans that agree with one another, tracked among themselves until
// together they are found again in the map, or begin one of their own.
//
// The uncertainty that a gap leaves does not grow while the sensor is followed: with the first of
// these scans expected at T_world_first, scan k is at T_world_first T_first_k. And a few scans
// together meet more of the map than one does, which distinguishes places that look alike to one.
// Scans too far apart for matching alone are searched for, as at the start of a recording. Scans of
// rain or spray, or of a covered sensor, agree with no other scan, not even a moment later.
#pragma once

#include <cstddef>
#include <deque>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/scan.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/pose_search.h"
#include "frontend/matching/scan_matcher.h"
#include "frontend/odometry/motion_model.h"

namespace lamina {

struct OdometryOptions;

// Not thread-safe; deterministic.
class LostTrack {
 public:
  LostTrack(const OdometryOptions& options, const VoxelMapOptions& map_options);

  // The next lost scan. One that does not agree with those before begins a track of its own, with
  // this body twist, per second, as far as anything is known. `usual_inliers`: the share of a scan
  // that lay on planes before the sensor was lost, 0 if that is not known. Where it was little, as
  // among trees, scans that agree have little in common as well.
  void Add(StampNs stamp_ns, const std::vector<TimedCluster>& clusters, const Vector6d& twist,
           double usual_inliers = 0.0);
  void Clear();
  // Whether stamps are measured. Before Add; as long as nothing is said they are.
  void SetStampsRecorded(bool recorded) { motion_.SetStampsRecorded(recorded); }

  // Scans that agree, the newest among them; 0 before the first.
  std::int64_t scans() const { return scans_; }
  StampNs first_stamp_ns() const { return first_stamp_ns_; }
  SE3 T_first_newest() const { return motion_.T_world_last(); }
  // Body twist at the newest scan, per second: measured from the second scan on.
  Vector6d Twist() const;
  // Seconds over which that was measured.
  double TwistOverS() const { return motion_.last_gap_s(); }
  // The newest scans, at most kKept, gathered by voxel, in the LiDAR frame of the newest.
  std::vector<PointCluster> Together() const;
  // The newest scan alone, in its LiDAR frame. Not before the first.
  const std::vector<PointCluster>& Newest() const { return kept_.back().clusters; }
  // Least fit with which a scan joins a track without a search for rivals.
  static constexpr double kLeastFit = 0.7;

  // Scans that overlap little drift against each other along a street, and together fit no place
  // well. If each alone fits the map, matched from where all together lie in it, takes the motion
  // from one to the next from the map; true if the track was bent before. `least_inliers`: the
  // share of a scan that must lie on planes.
  bool Straighten(const PosePrediction& newest, const VoxelMap& map, double least_inliers);

  // Records a pose of the newest scan in the map that is not certain.
  void Guess(const SE3& T_world_newest);
  // How many guesses in a row led to the same place as this one does.
  int Guessed(const SE3& T_world_newest) const;

  void Archive(StateArchive& a);

 private:
  static constexpr std::size_t kKept = 8;
  struct Scan {
    StampNs stamp_ns = 0;
    SE3 T_first_lidar;
    std::vector<TimedCluster> timed;
    std::vector<PointCluster> clusters;  // deskewed
  };
  // Whether the clusters agree with the scans before; fills their pose and deskews them under the
  // motion that it gives.
  bool Agrees(StampNs stamp_ns, const std::vector<TimedCluster>& clusters, double usual_inliers,
              Scan* scan) const;
  // The match of a scan so long after the last one that matching alone does not bridge the gap.
  MatchResult SearchFor(const std::vector<PointCluster>& clusters, const PosePrediction& prediction,
                        const VoxelMap& map) const;
  PoseHypotheses HypothesesFor(const PosePrediction& prediction) const;
  // Whether a match of a scan that follows another one without delay, with a fit as poor as that on
  // planes of one scan of few rings, is better than all that the search finds elsewhere.
  bool FitsHereAlone(const std::vector<PointCluster>& clusters, const PosePrediction& prediction,
                     const VoxelMap& map, const MatchResult& match) const;
  // Whether a sensor can have moved along these poses of the kept scans, by its acceleration.
  bool Drivable(const std::vector<SE3>& poses) const;

  ScanMatcher matcher_;
  VoxelMapOptions map_options_;
  MotionOptions motion_options_;
  PoseSearchOptions search_options_;
  MotionModel motion_;  // its world is the frame of the first scan
  std::deque<Scan> kept_;
  std::int64_t scans_ = 0;
  StampNs first_stamp_ns_ = 0;
  SE3 T_world_first_guess_;
  int guesses_ = 0;
};

}  // namespace lamina
