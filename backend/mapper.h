// The mapping algorithm, one scan after the other, without threads: odometry, keyframes, sliding
// window, hand-over of bundle adjustment.
//
//   Process(scan)      pose from odometry; a keyframe enters window and map
//   SolveDue()         whether a bundle adjustment of the window is to start now
//   PrepareSolve()     its problem, a self-contained copy: AdjustBundle may run on any thread
//   ApplySolve(...)    takes its result in: moves the window's frames, the map, the present pose.
//                      Frames that left the window meanwhile stay where the map has them
//
// When ApplySolve is called is for the caller to decide, as long as it is decided by counting
// frames: then the result is the same whatever the threads do (MappingPipeline).
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "backend/bundle_adjuster.h"
#include "backend/sliding_window.h"
#include "core/scan.h"
#include "core/voxel_map.h"
#include "frontend/odometry.h"

namespace lamina {

struct BackendOptions {
  // Off: poses stay as the frontend found them; everything else is the same.
  bool enabled = true;
  // A bundle adjustment starts every so many keyframes, and its result takes effect so many frames
  // later.
  int solve_every_keyframes = 5;
  int hand_over_lag_frames = 2;
  // A frame becomes a keyframe when it moved or turned so far from the last one. 0: every frame.
  double keyframe_translation_m = 0.03;
  double keyframe_rotation_deg = 0.3;
  // Lost for so many frames in a row: the next one enters the map at its predicted pose after all.
  int restart_after_lost_frames = 20;
  // Frames that must have seen a plane before it counts as part of the map that is written out.
  int min_surfel_frames = 2;
  SlidingWindowOptions window;
  BundleAdjusterOptions solver;

  void Visit(OptionVisitor& v);
};

struct MapperOptions {
  VoxelMapOptions map;
  OdometryOptions odometry;
  BackendOptions backend;
};

struct MappedFrame {
  OdometryFrame odometry;
  bool keyframe = false;
  bool restarted = false;  // lost for so long that mapping starts anew from the prediction
};

// What is known of a frame once it is processed.
struct FrameRecord {
  StampNs stamp_ns = 0;
  SE3 T_world_lidar;  // final once the window has passed
  bool keyframe = false;
  std::int64_t keyframe_id = 0;  // the keyframe that it hangs on (itself, if it is one)
  SE3 T_keyframe_lidar;
};

class Mapper {
 public:
  // `on_evicted` gets the planes of parts of the map that leave memory; may be empty.
  Mapper(const MapperOptions& options, std::function<void(const Surfel&)> on_evicted);

  // Stamps must increase. A lost frame leaves the map as it is.
  MappedFrame Process(StampNs stamp_ns, std::vector<TimedCluster> clusters);

  bool SolveDue() const;
  // Whether there is anything to solve at all, due or not.
  bool SolvePossible() const;
  BundleProblem PrepareSolve();
  void ApplySolve(const BundleResult& result);

  // Poses of all frames so far, as known now.
  Trajectory CurrentTrajectory() const;

  const VoxelMap& map() const { return map_; }

 private:
  OdometryFrame Register(StampNs stamp_ns, const std::vector<TimedCluster>& clusters);
  bool IsKeyframe(const SE3& T_world_lidar) const;
  void AddKeyframe(const OdometryFrame& frame, std::vector<TimedCluster> clusters);
  // Deskews the last keyframe again, now that the motion after it is known too. False if it makes
  // no difference.
  bool RefineLastTwist(StampNs stamp_ns, const SE3& T_world_lidar);

  MapperOptions options_;
  VoxelMap map_;
  Odometry odometry_;
  SlidingWindow window_;
  std::vector<FrameRecord> records_;
  // By keyframe id: final poses and, of frames in the window, the same ones as there.
  std::vector<SE3> keyframes_;
  int keyframes_since_solve_ = 0;
  std::vector<std::int64_t> solving_;  // ids of the frames of the problem under way
  int lost_in_a_row_ = 0;
  std::function<void(const Surfel&)> on_evicted_;
};

}  // namespace lamina
