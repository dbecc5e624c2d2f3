// The frames that bundle adjustment may still move, and their share of the map.
//
// Each frame keeps its clusters as measured (with time), as deskewed under its present motion, and
// as they stand in the voxel map at its present pose. Moving frames or changing their motion
// exchanges exactly those clusters in the map, leaf by leaf; association to leaves is made once,
// when the frame enters. The oldest frame leaves by marginalisation: its clusters join the fixed
// clusters of their leaves at the final pose, with the robust weights that they had in the last
// bundle adjustment, so that clusters which it rejected do not anchor the map.
//
// Not thread-safe. The map must outlive the window and be changed by the window alone.
#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "backend/bundle/problem.h"
#include "backend/submaps/final_keyframe.h"
#include "core/geometry/scan.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"
#include "core/options/options.h"
#include "frontend/matching/scan_matcher.h"
#include "frontend/scan/scan_clusters.h"

namespace lamina {

class ObservationPlaces;
class ObservationWeights;

struct SlidingWindowOptions {
  int frames = 15;
  // Scale of the robust kernel on a cluster's distance to its plane, in standard deviations.
  double kernel_sigma = 3.0;
  // Planes of one solve at most; those seen by most frames are kept.
  int max_planes = 20000;
  // Standard deviation of the frontend's motion from frame to frame, where no plane says better.
  double prior_rotation_deg = 0.5;
  double prior_translation_m = 0.1;

  void Visit(OptionVisitor& v);
};

struct WindowFrame {
  std::int64_t id = 0;
  StampNs stamp_ns = 0;  // of the reference instant (SweepMotion)
  SE3 T_world_lidar;
  SweepMotion sweep;                     // during the scan
  std::vector<TimedCluster> measured;    // emptied if they carry no time: nothing to deskew
  std::vector<PointCluster> deskewed;    // LiDAR frame at the reference instant (SweepMotion)
  std::vector<PointCluster> in_map;      // world frame, capped weight
  std::vector<VoxelMap::NodeId> leaves;  // kNoNode: outside of what the map can hold
  std::vector<VoxelMap::LeafAddress> addresses;
  // The first of its map: its clusters must be planes by themselves, so they may weigh as much as a
  // plane needs (VoxelMapOptions::min_points).
  bool alone = false;
  // Robust weight of each cluster in the last problem, with which it is marginalised; negative
  // where it was on no plane, empty before the first problem (observation_weights.h).
  std::vector<double> weights;
  // Directions that the frontend's planes left open, and the information that holds the frontend's
  // motion there (MatchResult::degenerate_directions, degenerate_information; zero ends them).
  Matrix6d held = Matrix6d::Zero();
  Vector6d held_information = Vector6d::Zero();
  SE3 T_previous_this;  // motion since the frame before, as the frontend found it
  // The unit vector of the scaled tangent along which the frontend's match is least sure of the
  // pose, and its standard deviation there; 0 where no prediction confirms the match.
  Vector6d weakest = Vector6d::Zero();
  double weakest_sigma_m = 0.0;
  // Sets these two by the covariance of the match (MatchResult). A prediction confirms it within
  // kAstrayM.
  void SetWeakest(const Matrix6d& covariance, const SE3& T_world_predicted);
};

class SlidingWindow {
 public:
  // Frames farther apart in time say nothing of the velocity at either.
  static constexpr double kMaxTwistGapS = 0.5;
  // A bundle adjustment that makes planes sharper moves a frame by less than this.
  static constexpr double kAstrayM = 0.05;

  SlidingWindow(const SlidingWindowOptions& options, VoxelMap* map);

  const SlidingWindowOptions& options() const { return options_; }
  const std::deque<WindowFrame>& frames() const { return frames_; }
  bool full() const { return static_cast<int>(frames_.size()) >= options_.frames; }

  // Puts a frame into window and map. id, stamp, pose, sweep and `measured` must be set.
  void Push(WindowFrame frame);

  // What frame i would leave to the map if it were marginalised now.
  FinalKeyframe AsFinal(std::size_t i) const;
  // Marginalises the oldest frame; `left`, unless null, is what it leaves to the map.
  void PopOldest(FinalKeyframe* left = nullptr);

  // Sets the pose of frame i and leaves its clusters to a later Move.
  void SetPose(std::size_t i, const SE3& T_world_lidar) {
    frames_[i].T_world_lidar = T_world_lidar;
  }
  // The motion to frame i from the one before it, where the frontend's is known to be wrong.
  void SetMotionTo(std::size_t i, const SE3& T_previous_this) {
    frames_[i].T_previous_this = T_previous_this;
  }
  // Moves frame i to a new pose and motion. The map must be refreshed afterwards.
  void Move(std::size_t i, const SE3& T_world_lidar, const SweepMotion& sweep);

  // The share of the clusters in the map that no longer lie in their leaves.
  double ShareAstray() const;
  // Adds the clusters of all frames to a map that has none of them any more, each to the leaf in
  // which it lies now: Move() leaves it in the one it was added to. The map must be refreshed
  // afterwards.
  void AddAnew();

  // The motion during frame i, from the poses of its neighbours (sweep_motion.h), in the window or
  // the last ones that have left it: those within max_gap_s. `next`: the pose after the newest
  // frame, or null.
  SweepMotion MotionAt(std::size_t i, const StampedPose* next = nullptr,
                       double max_gap_s = kMaxTwistGapS) const;

  // Holds frames that a solution leads astray to the frontend's motion from now on; true if there
  // is one. Few planes that face a direction leave minima beside the right one, as sharp as that:
  // the frontend, which knows the motion, has chosen among them (direction_profile.h), the descent
  // of bundle adjustment has not. Astray is what is farther from the frontend's motion along the
  // frame's weakest direction than 3 standard deviations and kAstrayM. `poses` are of the frames of
  // these ids.
  bool HoldAstray(const std::vector<std::int64_t>& ids, const std::vector<SE3>& poses);

  // Planes of the map seen by the window's frames, with weights applied: caps and kernel on the
  // observations (the frames keep them until they are marginalised), 1 / variance on the planes,
  // and far less on those much thicker than the others.
  BundleProblem BuildProblem();

  // Reading finds the leaves in the map, which must hold what it held when this was written, and
  // holds them again. Throws InputError if it does not.
  void Archive(StateArchive& a);

 private:
  // The number of the observation that each cluster of frame f goes into; -1: none.
  std::vector<std::int32_t> NumberObservations(std::size_t f, const ObservationWeights& on_planes,
                                               ObservationPlaces* numbers) const;
  // Sums frame f's clusters, weighted, into their observations.
  void FillObservations(std::size_t f, const std::vector<std::int32_t>& of_clusters,
                        const std::vector<std::int32_t>& places, BundleProblem* problem) const;
  void FindLeaves(WindowFrame* frame) const;
  // Holds the first frame along the directions that its planes left open: motion priors hold the
  // others to it, and nothing else would keep the window from sliding as a whole.
  void HoldFirst(BundleProblem* problem) const;
  RelativePrior MotionPrior(std::size_t i) const;
  // Adds frame->in_map, and notes its leaves.
  void AddToMap(WindowFrame* frame);
  // The clusters of a frame as they stand in the map when it is at T.
  void MoveIntoMap(const WindowFrame& frame, const SE3& T, std::vector<PointCluster>* in_map) const;
  // Has the processor fetch what a loop over the clusters of a frame, now at i, is soon to change.
  void PrefetchLeaves(const WindowFrame& frame, std::size_t i) const;
  // Weight with which cluster i of a frame that leaves the window joins the fixed clusters.
  double MarginalWeight(const WindowFrame& frame, std::size_t i) const;

  SlidingWindowOptions options_;
  VoxelMap* map_;
  std::deque<WindowFrame> frames_;
  Trajectory left_;  // the last poses that have left the window, at most kMotionNeighbours
  std::vector<PointCluster> moved_;  // of a frame that is being moved: memory that is used again
};

}  // namespace lamina
