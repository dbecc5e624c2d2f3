// The mapping algorithm of one piece of the map, one scan after the other, without threads:
// odometry, keyframes, sliding window, hand-over of bundle adjustment.
//
// All poses are in the frame of the piece, the *world* of its mapper. Several mappers may work on
// pieces of one map in turn (Mapping); each selects its own before it touches the map.
//
//   Process(scan)      pose from odometry; a keyframe enters window and map
//   TakeFinal(...)     poses that nothing will change any more
//   SolveDue()         whether a bundle adjustment of the window is to start now
//   PrepareSolve()     its problem, a self-contained copy: AdjustBundle may run on any thread
//   ApplySolve(...)    takes its result in: moves the window's frames, the map, the present pose.
//                      Frames that left the window meanwhile stay where the map has them
//
// When ApplySolve is called is for the caller to decide, as long as it is decided by counting
// frames: then the result is the same whatever the threads do (PieceMapper).
#pragma once

#include <cstdint>
#include <deque>
#include <utility>
#include <vector>

#include "backend/bundle/adjuster.h"
#include "backend/mapping/degenerate_stretch.h"
#include "backend/mapping/sliding_window.h"
#include "core/geometry/scan.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"
#include "frontend/odometry/lost_track.h"
#include "frontend/odometry/odometry.h"
#include "frontend/start/start_track.h"

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
  // Also when so many frames have come since the last one: a sensor that stands still makes a map
  // of the place, too. 0: never for that reason.
  int keyframe_after_frames = 100;
  // A pose is final when so many scans have come after it, wherever the window stands.
  int final_after_frames = 300;
  // Lost for so many frames in a row: the next one begins a piece of its own, at its predicted
  // pose.
  int restart_after_lost_frames = 20;
  // So does one that is less certain than this against what was mapped before a stretch of
  // degenerate scans, once scans determine all directions again (degenerate_stretch.h). 0: never.
  double restart_after_sigma_m = 0.1;
  // Frames that must have seen a plane before it counts as part of the map that is written out.
  int min_surfel_frames = 2;
  SlidingWindowOptions window;
  BundleAdjusterOptions solver;

  // Frames that a solve needs at least.
  static constexpr int kLeastSolved = 3;

  void Visit(OptionVisitor& v);
  // Throws OptionError, naming both, for options that contradict one another.
  void CheckTogether() const;
};

struct MapperOptions {
  VoxelMapOptions map;
  OdometryOptions odometry;
  BackendOptions backend;
  // Pieces are looked for in one another: lost where no search for the expected pose reaches, scans
  // begin a piece as soon as they agree.
  bool pieces_are_found = false;
};

// A scan as a mapper takes it.
struct MapperScan {
  std::int64_t number = 0;  // increases from scan to scan, and so does the stamp
  StampNs stamp_ns = 0;
  bool stamp_made_up = false;                     // Scan::stamp_made_up
  std::vector<TimedCluster>* clusters = nullptr;  // taken if the scan becomes a keyframe
  // The instant after the stamp from which the clusters' times count. Poses in the window are those
  // at that instant, the middle of a sweep: motion within the scan that is not steady shifts a
  // point by acceleration * time^2 / 2, which is four times as much from one end.
  StampNs middle_ns = 0;
};

struct RegisteredScan {
  OdometryFrame odometry;
  bool keyframe = false;
  // This scan is to begin a piece of its own, and was left out of this one: lost for so long, after
  // scans that agree with one another, and that the map does not have (rain and spray begin no
  // map), or tracked, but at an unknown place against what was mapped before.
  bool to_restart = false;
};

// A frame whose pose bundle adjustment may still move.
struct OpenFrame {
  std::int64_t scan = 0;
  StampNs stamp_ns = 0, middle_ns = 0;  // MapperScan
  // The keyframe that it hangs on (itself, if it is one). kNoKeyframe: none, T_keyframe_lidar is
  // T_world_lidar.
  static constexpr std::int64_t kNoKeyframe = -1;
  std::int64_t keyframe_id = kNoKeyframe;
  SE3 T_keyframe_lidar;  // in the middle of the sweep
  SE3 T_middle_stamp;    // what the sensor moved between
};

class Mapper {
 public:
  // `piece` must be one of the map's, which must outlive the mapper. The first scan is at
  // `T_world_start`.
  Mapper(const MapperOptions& options, VoxelMap* map, std::int64_t piece,
         const SE3& T_world_start = SE3());

  // A lost frame leaves the map as it is. Without `may_restart` a frame is lost however many were
  // before.
  RegisteredScan Process(const MapperScan& scan, bool may_restart = true);

  bool SolveDue() const;
  // Whether there is anything to solve at all, due or not.
  bool SolvePossible() const;
  BundleProblem PrepareSolve();
  // False if nothing of it could be used: it failed, or all of its frames have left the window.
  bool ApplySolve(const BundleResult& result);

  // To be told of each keyframe that leaves the window.
  void TellFinalKeyframes(OnFinalKeyframe tell) { on_final_keyframe_ = std::move(tell); }
  // Of those that are in the window at the end, too.
  void TellWindow() const;
  // Those in the window, as they stand.
  std::vector<FinalKeyframe> WindowKeyframes() const;

  // From now on scans are matched to the map and leave it as it is, the first one near this pose.
  // Before any scan.
  void StartLocalising(const SE3& T_world_lidar);
  // The same where the map is known to have had the sensor in the last scans. When it is lost for
  // long, a scan is to begin a piece of its own.
  void StartLocalising(const Trajectory& last);

  // Where a stretch of degenerate scans is over: the keyframes that determine one another again.
  std::vector<WindowFrame> SettledFrames() const;
  // The next scan follows the last one of another mapper, in the same world, and the map of this
  // one begins with these keyframes of it. Before any scan.
  void GoOnFrom(const Mapper& before, std::vector<WindowFrame> frames);

  // The sensor was found in the piece, in which it had these last scans: mapping goes on there.
  // Before any scan. `keyframe`: number of the next one, behind all that the piece has had.
  void Resume(const Trajectory& last, std::int64_t keyframe);

  // No more scans come: the frames of the window join the fixed part of the map as they stand, and
  // all poses are final. Nothing is kept of a piece in which no scan was ever matched: another may
  // have its place in the map. Then this mapper is of no use any more.
  void Close();

  // Poses that have become final since the last call: of the frames behind the window, and of all
  // scans with a number below `before_scan`. A sensor that stands still, or whose scans have ceased
  // to come, gives the window no reason to move on, but what is open is in memory, in every
  // checkpoint, and in what is shown; and the keyframe that such a frame hangs on hardly moves.
  Trajectory TakeFinal(std::int64_t before_scan);
  // Poses of the frames after those, as known now.
  Trajectory OpenFrames() const;

  // Where the points of the newest keyframe are in the world: the means of its clusters.
  std::vector<Eigen::Vector3d> NewestKeyframe() const;

  // All but the map and the piece's number.
  void Archive(StateArchive& a);

  std::int64_t piece() const { return piece_; }

 private:
  OdometryFrame Register(StampNs stamp_ns, const std::vector<TimedCluster>& clusters);
  OdometryFrame First(StampNs stamp_ns) const;
  void AcceptLast(const Trajectory& last);
  void DropWindow();
  void PopOldest();
  bool IsKeyframe(const SE3& T_world_lidar) const;
  void AddKeyframe(const OdometryFrame& frame, std::vector<TimedCluster> clusters);
  // The same for a scan that follows a lost one.
  OdometryFrame FindAgain(StampNs stamp_ns, const std::vector<TimedCluster>& clusters);
  // While the first scans have several explanations. *frame is what odometry made of this one. True
  // if they are taken again under another explanation.
  bool FollowStart(const MapperScan& scan, OdometryFrame* frame);
  // Takes back all scans so far and takes them again as start_ has them; *frame is of the newest.
  void StartOver(OdometryFrame* frame);
  // Whether a lost scan is to begin a map anew.
  bool MayRestart() const;
  // The first scan is at T_world_start_ at its stamp, which is known to lie elsewhere than the
  // middle of its sweep once the motion is: moves it there, and with it *frame, the scan after it.
  void MoveToStart(OdometryFrame* frame);
  // Where the first scan was in the middle of its sweep, under this motion.
  SE3 FirstMiddle(const SweepMotion& sweep) const;
  // Deskews the last keyframe again, now that the motion after it is known too. False if it makes
  // no difference.
  bool RefineLastTwist(StampNs stamp_ns, const SE3& T_world_lidar);
  // Brings back what the map had where this scan is expected.
  void RecallAround(const SE3& T_world_lidar, const std::vector<TimedCluster>& clusters);
  // In the middle of its sweep, and at its stamp.
  StampedPose MiddleOf(const OpenFrame& frame) const;
  StampedPose PoseOf(const OpenFrame& frame) const;
  // A frame that was registered becomes an open one; what moved the sensor within the one before is
  // better known now.
  void Open(const MapperScan& scan, const OdometryFrame& frame);
  SE3& Keyframe(std::int64_t id) { return keyframes_[static_cast<std::size_t>(id - first_id_)]; }
  const SE3& Keyframe(std::int64_t id) const {
    return keyframes_[static_cast<std::size_t>(id - first_id_)];
  }
  std::int64_t NextId() const { return first_id_ + static_cast<std::int64_t>(keyframes_.size()); }

  MapperOptions options_;
  VoxelMap* map_;
  std::int64_t piece_;
  SE3 T_world_start_;
  Odometry odometry_;
  SlidingWindow window_;
  std::deque<OpenFrame> open_;
  // Poses of the keyframes in the window, and of those before them on which open frames hang.
  std::deque<SE3> keyframes_;
  std::int64_t first_id_ = 0;  // of the first of them
  int keyframes_since_solve_ = 0;
  int frames_since_keyframe_ = 0;
  std::vector<std::int64_t> solving_;  // ids of the frames of the problem under way
  int lost_in_a_row_ = 0;
  LostTrack lost_track_;
  StartTrack start_;
  DegenerateStretch stretch_;
  OnFinalKeyframe on_final_keyframe_;
  bool matched_ = false;  // any scan, ever
  bool localising_ = false;
  bool may_restart_ = true;  // when it is lost for long
};

}  // namespace lamina
