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
#include <utility>
#include <vector>

#include "backend/bundle/solver/adjuster.h"
#include "backend/pieces/ambiguous_place.h"
#include "backend/pieces/degenerate_stretch.h"
#include "backend/pieces/mapper_options.h"
#include "backend/pieces/open_poses.h"
#include "backend/pieces/scan_tracker.h"
#include "backend/window/sliding_window.h"
#include "core/geometry/scan.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"
#include "frontend/start/rest_at_start.h"
#include "frontend/start/resting_beams.h"
#include "frontend/start/start_track.h"

namespace lamina {

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
  // False if nothing of it could be used: it failed, all of its frames have left the window, or it
  // leads one of them astray (SlidingWindow::HoldAstray).
  bool ApplySolve(const BundleResult& result);

  // Called with each keyframe that leaves the window.
  void SetOnFinalKeyframe(OnFinalKeyframe tell) { on_final_keyframe_ = std::move(tell); }
  // Calls it with those still in the window, at the end of the recording.
  void EmitWindowKeyframes() const;
  // Keyframes of the window, as they stand.
  std::vector<FinalKeyframe> WindowKeyframes() const;

  // The keyframes that the next piece goes on with, after a degenerate stretch or in an ambiguous
  // place: those since then, which determine one another.
  std::vector<WindowFrame> SettledFrames() const;
  // The first scans come after those of another mapper, which lost them or gave up a start.
  void StartAfter(const Mapper& before) { start_.FollowPiece(before.start_given_up()); }
  // Whether no motion explains the scans so far: the poses of all of them are chance.
  bool start_given_up() const { return start_.given_up(); }
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
  Trajectory OpenFrames() const { return open_.AtStamps(); }

  // Where the points of the newest keyframe are in the world: the means of its clusters.
  std::vector<Eigen::Vector3d> NewestKeyframe() const;

  // All but the map and the piece's number.
  void Archive(StateArchive& a);

  std::int64_t piece() const { return piece_; }

 private:
  OdometryFrame Register(const MapperScan& scan);
  OdometryFrame First(const MapperScan& scan);
  OdometryFrame Track(const MapperScan& scan);
  // The second scan, and with it the motion of the first one; as that of a sensor that is shaken if
  // the two do not agree otherwise (shaken_sweep.h).
  OdometryFrame RegisterSecond(const MapperScan& scan);
  // Moves the clusters of a window that begins with the first scan into the leaves in which they
  // lie now, if more of them than the share `few` have left those they were added to, where no scan
  // would find them. True if so.
  bool PlaceWindowAnew(double few);
  void AgreeWithFirst(const MapperScan& scan, OdometryFrame* frame);
  // Follows what may end the piece: its start, degenerate scans, losses.
  PieceEnd EndOfPiece(const MapperScan& scan, const OdometryFrame& frame, bool may_restart);
  // Whether scans that determine all directions, but whose place in what was mapped before is
  // unknown or ambiguous, are to begin a piece that goes on from this one.
  bool EndsInOpen(bool may_restart);
  void DropWindow();
  void PopOldest();
  bool IsKeyframe(const SE3& T_world_lidar) const;
  void AddKeyframe(const OdometryFrame& frame, std::vector<TimedCluster> clusters);
  // Follows the first scans as long as they have several explanations; *result has odometry's frame
  // of this one. True if they are taken again under another explanation.
  bool FollowStart(const MapperScan& scan, RegisteredScan* result);
  // Whether all that entered the map since the piece began, during which the sensor has hardly done
  // more than rest, can be taken back.
  bool RestIsWhole() const;
  // Accepts the newest scan at the pose of *result. Its clusters are taken if it becomes a
  // keyframe.
  void Accept(bool started_over, RegisteredScan* result, std::vector<TimedCluster>* clusters);
  // The sensor has rested and sets off: takes back what was made of its scans, begins with the last
  // of them, and registers this one anew.
  OdometryFrame StartFromRest(const MapperScan& scan);
  // Takes back the window, all of which is of the start or of scans before it. Returns the poses of
  // the latter, for HangBefore().
  std::vector<SE3> TakeBack();
  void HangBefore(const std::vector<SE3>& before);
  // Ends the detection of starts and rests: the initial motion is known.
  void ClearStart();
  // If ranges contradict a sensor that seems to rest, the frame is degenerate, and soon lost.
  void DoubtRest(OdometryFrame* frame);
  // MapperOptions::start_velocity applies to piece 0 only.
  bool StartsMoving() const { return piece_ == 0 && options_.start_velocity.has_value(); }
  // Takes back the scans of the start and takes them again as start_ has them; *frame is of the
  // newest.
  void StartOver(OdometryFrame* frame);
  // The first scan is at T_world_start_ at its stamp, which is known to lie elsewhere than the
  // middle of its sweep once the motion is: moves it there, and with it *frame, the scan after it.
  void MoveToStart(OdometryFrame* frame);
  // Pose of the first scan in the middle of its sweep, under this motion.
  SE3 FirstMiddle(const SweepMotion& sweep) const;
  // Splits a shake between the first two scans, `second` being the shaken one: only the difference
  // of their motions is known so far.
  bool SplitShake(const OdometryFrame& second);
  // SplitShake or RefineLastTwist, now that this frame is known. False if it makes no difference.
  bool RefineFirstOrLast(const OdometryFrame& frame);
  // Deskews the last keyframe again, now that the motion after it is known too. False if it makes
  // no difference.
  bool RefineLastTwist(StampNs stamp_ns, const SE3& T_world_lidar);

  // Matches the first scan to the map of the keyframes after it, once these are enough, to correct
  // its place among them: it stays, and they move.
  void SettleFirst();
  // Moves the keyframes of these ids to these poses, and with the last one those after it and
  // odometry.
  void MoveKeyframes(const std::vector<std::int64_t>& ids, const std::vector<SE3>& poses);

  MapperOptions options_;
  VoxelMap* map_;
  std::int64_t piece_;
  SE3 T_world_start_;
  ScanTracker tracker_;
  SlidingWindow window_;
  OpenPoses open_;
  int keyframes_since_solve_ = 0;
  int frames_since_keyframe_ = 0;
  std::vector<std::int64_t> solving_;  // ids of the frames of the problem under way
  StartTrack start_;
  DegenerateStretch stretch_;
  AmbiguousPlace ambiguous_;
  RestingBeams resting_;
  RestAtStart rest_;
  std::size_t before_start_ = 0;  // number of open poses of scans before the start
  OnFinalKeyframe on_final_keyframe_;
  bool matched_ = false;        // any scan, ever
  bool first_settled_ = false;  // SettleFirst
};

}  // namespace lamina
