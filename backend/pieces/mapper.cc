#include "backend/pieces/mapper.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "backend/pieces/first_pose.h"
#include "backend/pieces/sweep_stamp.h"
#include "core/base/angle.h"

namespace lamina {
namespace {

// Share of the clusters of a window that a sensor setting off moves out of their leaves.
constexpr double kFewAstray = 0.05;

}  // namespace

Mapper::Mapper(const MapperOptions& options, VoxelMap* map, std::int64_t piece,
               const SE3& T_world_start)
    : options_(options),
      map_(map),
      piece_(piece),
      T_world_start_(T_world_start),
      tracker_(options),
      window_(options.backend.window, map),
      start_(options.frontend, options.map),
      stretch_(options.frontend),
      resting_(options.map.noise_floor_m) {
  CheckOptions(options.backend, "backend");
  options.backend.CheckTogether();
  if (StartsMoving()) ClearStart();
}

RegisteredScan Mapper::Process(const MapperScan& scan, bool may_restart) {
  RegisteredScan result;
  map_->SelectPiece(piece_);
  SettleFirst();
  result.odometry = Register(scan);
  OdometryFrame& frame = result.odometry;
  if (frame.status != OdometryFrame::Status::kLost)
    resting_.Add(*scan.clusters, frame.T_world_lidar);
  if (rest_.SetsOff(frame, scan.stamp_made_up, *scan.clusters, resting_.newest())) {
    if (RestIsWhole()) frame = StartFromRest(scan);
    rest_.End();
  }
  const bool started_over = start_.open() && FollowStart(scan, &result);
  DoubtRest(&frame);
  result.ends = EndOfPiece(scan, frame, may_restart);
  if (result.ends == PieceEnd::kNone) {
    if (frame.status != OdometryFrame::Status::kLost) {
      const bool first = open_.NextKeyframe() == 0;
      Accept(started_over, &result, scan.clusters);
      if (StartsMoving() && first) tracker_.odometry().StartMoving(*options_.start_velocity);
    }
    // The last keyframe's clusters may have moved though nothing new entered the map.
    map_->Refresh();
    open_.Add(scan, frame);
    stretch_.Widen(&frame.match);
    ambiguous_.Widen(&frame.match);
    // Marked after DegenerateStretch::Follow, so that these frames do not open a degenerate
    // stretch.
    if (!frame.elsewhere.isZero()) frame.match.MayBeElsewhere(frame.elsewhere);
    if (start_.unproven()) frame.match.MakeDegenerate();
  }
  MoveToStamp(scan.middle_ns, &frame);
  return result;
}

void Mapper::Accept(bool started_over, RegisteredScan* result,
                    std::vector<TimedCluster>* clusters) {
  const OdometryFrame& frame = result->odometry;
  matched_ = matched_ || frame.status == OdometryFrame::Status::kTracked;
  tracker_.Accept(frame);
  if (started_over) tracker_.odometry().Assume(frame.sweep.twist);
  ++frames_since_keyframe_;
  result->keyframe = IsKeyframe(frame.T_world_lidar);
  if (result->keyframe) AddKeyframe(frame, std::move(*clusters));
}

OdometryFrame Mapper::First(const MapperScan& scan) {
  Odometry& odometry = tracker_.odometry();
  odometry.SetStampsRecorded(!scan.stamp_made_up);
  OdometryFrame frame;
  frame.stamp_ns = scan.stamp_ns + scan.middle_ns;
  if (odometry.started()) frame.sweep = odometry.Twist(frame.stamp_ns);
  if (StartsMoving()) frame.sweep = *options_.start_velocity;
  frame.T_world_lidar = T_world_start_ * AtStamp(frame.sweep, scan.middle_ns).Inverse();
  return frame;
}

OdometryFrame Mapper::Register(const MapperScan& scan) {
  if (open_.NextKeyframe() == 0) return First(scan);
  const bool was_lost = tracker_.lost();
  if (open_.NextKeyframe() == 1 && !was_lost && !window_.frames().empty())
    return RegisterSecond(scan);
  OdometryFrame frame = Track(scan);
  if (!was_lost) RefineFirstOrLast(frame);
  return frame;
}

OdometryFrame Mapper::Track(const MapperScan& scan) {
  return tracker_.Register(scan.stamp_ns + scan.middle_ns, scan.stamp_made_up, *scan.clusters, map_,
                           /*map_is_older=*/false);
}

OdometryFrame Mapper::RegisterSecond(const MapperScan& scan) {
  Odometry& odometry = tracker_.odometry();
  const SweepMotion first = window_.frames().front().sweep;
  OdometryFrame frame = Track(scan);
  AgreeWithFirst(scan, &frame);
  if (!AnyTimed(*scan.clusters) || !odometry.SeemsShaken(frame)) return frame;
  if (frame.status == OdometryFrame::Status::kTracked) {
    window_.Move(0, window_.frames().front().T_world_lidar, first);
    MoveToStart(&frame);
    PlaceWindowAnew(kFewAstray);
  }
  odometry.MayBeShaken(true);
  frame = Track(scan);
  AgreeWithFirst(scan, &frame);
  odometry.MayBeShaken(false);
  return frame;
}

void Mapper::AgreeWithFirst(const MapperScan& scan, OdometryFrame* frame) {
  // The first scan was put into the map as if the sensor stood still: one scan later its motion is
  // known, so both are brought to agree before anything is built on them.
  constexpr int kRounds = 4;
  double few = kFewAstray;
  for (int i = 0; i < kRounds && RefineFirstOrLast(*frame); ++i) {
    MoveToStart(frame);
    if (PlaceWindowAnew(few)) few = 0.0;
    // The first scan is deskewed now, so this one must be deskewed from the beginning as well:
    // otherwise it is off by the motion during half a sweep, if its stamp is at the start.
    tracker_.odometry().Rematch(*scan.clusters, *map_, frame);
  }
}

bool Mapper::PlaceWindowAnew(double few) {
  map_->Refresh();
  if (!window_.frames().front().alone || window_.ShareAstray() <= few) return false;
  DropWindow();
  map_->BeginPiece(piece_);
  window_.AddAnew();
  map_->Refresh();
  return true;
}

bool Mapper::RefineFirstOrLast(const OdometryFrame& frame) {
  if (frame.status != OdometryFrame::Status::kTracked) return false;
  if (frame.sweep.of_scan && open_.NextKeyframe() == 1) return SplitShake(frame);
  return RefineLastTwist(frame.stamp_ns, frame.T_world_lidar);
}

SE3 Mapper::FirstMiddle(const SweepMotion& sweep) const {
  return T_world_start_ * AtStamp(sweep, open_.FirstMiddleNs()).Inverse();
}

void Mapper::MoveToStart(OdometryFrame* frame) {
  // If the window does not begin with a first scan the piece was there before, and its pose stays.
  const WindowFrame& first = window_.frames().front();
  if (!first.alone || open_.size() == 0 || open_.FirstMiddleNs() == 0) return;
  // A first pose that is final already stays.
  if (open_.FirstMiddle().stamp_ns != first.stamp_ns) return;
  const SweepMotion sweep = first.sweep;
  const SE3 T_world_middle = FirstMiddle(sweep);
  const SE3 correction = T_world_middle * first.T_world_lidar.Inverse();
  window_.Move(0, T_world_middle, sweep);
  open_.Keyframe(first.id) = T_world_middle;
  tracker_.odometry().Correct(correction);
  start_.Move(correction);
  rest_.Move(correction);
  for (SE3* T : {&frame->T_world_lidar, &frame->T_world_predicted, &frame->match.T_world_lidar})
    *T = correction * *T;
}

bool Mapper::IsKeyframe(const SE3& T) const {
  // The first frames are keyframes wherever the sensor is: one that stands still makes a map, too,
  // however short the recording.
  if (!open_.any_keyframe() || open_.NextKeyframe() < options_.backend.min_surfel_frames)
    return true;
  const int most = options_.backend.keyframe_after_frames;
  // Keyframes of a rest stay in the window, to be taken back if the sensor sets off.
  const bool may_leave = window_.full() && rest_.rests() && RestIsWhole();
  if (most > 0 && frames_since_keyframe_ >= most && !may_leave) return true;
  const SE3& last = open_.newest_keyframe();
  return (T.t - last.t).norm() >= options_.backend.keyframe_translation_m ||
         RotationAngle(last, T) >= Radians(options_.backend.keyframe_rotation_deg);
}

bool Mapper::SplitShake(const OdometryFrame& second) {
  const WindowFrame& first = window_.frames().front();
  if (!first.alone || first.measured.empty()) return false;
  const double dt = SecondsBetween(first.stamp_ns, second.stamp_ns);
  const Vector6d mean = MeanTwist(first.T_world_lidar, second.T_world_lidar, dt);
  window_.Move(0, first.T_world_lidar, FirstOfTwo(mean, dt, first.sweep, second.sweep));
  return true;
}

bool Mapper::RefineLastTwist(StampNs stamp_ns, const SE3& T_world_lidar) {
  if (window_.frames().empty() || window_.frames().back().measured.empty()) return false;
  const std::size_t last = window_.frames().size() - 1;
  const WindowFrame& frame = window_.frames()[last];
  const double dt = SecondsBetween(frame.stamp_ns, stamp_ns);
  // Nothing else tells the motion during the first scan, so that a longer gap is allowed.
  const double most_s = last == 0 ? MotionModel::kMotionOfS : SlidingWindow::kMaxTwistGapS;
  // Only the first scan after a keyframe is used: it tells most of the motion during that.
  if (frames_since_keyframe_ > 0 || dt <= 0.0 || dt > most_s) return false;
  const StampedPose next{stamp_ns, T_world_lidar};
  window_.Move(last, frame.T_world_lidar, window_.MotionAt(last, &next, most_s));
  return true;
}

void Mapper::AddKeyframe(const OdometryFrame& odometry, std::vector<TimedCluster> clusters) {
  if (window_.full()) PopOldest();
  WindowFrame frame;
  frame.id = open_.NextKeyframe();
  frame.stamp_ns = odometry.stamp_ns;
  frame.T_world_lidar = odometry.T_world_lidar;
  frame.sweep = odometry.sweep;
  frame.alone = odometry.status != OdometryFrame::Status::kTracked;
  frame.held = odometry.match.degenerate_directions;
  frame.held_information = odometry.match.degenerate_information;
  if (open_.any_keyframe())
    frame.T_previous_this = open_.newest_keyframe().Inverse() * frame.T_world_lidar;
  if (odometry.status == OdometryFrame::Status::kTracked && odometry.match.degenerate == 0)
    frame.SetWeakest(odometry.match.covariance, odometry.T_world_predicted);
  frame.measured = std::move(clusters);
  open_.AddKeyframe(frame.T_world_lidar);
  window_.Push(std::move(frame));
  map_->Refresh();
  map_->EvictToBudget();
  ++keyframes_since_solve_;
  frames_since_keyframe_ = 0;
}

bool Mapper::SolvePossible() const {
  return options_.backend.enabled && solving_.empty() &&
         window_.frames().size() >= static_cast<std::size_t>(BackendOptions::kLeastSolved);
}

bool Mapper::SolveDue() const {
  return SolvePossible() && !start_.contested() &&
         keyframes_since_solve_ >= options_.backend.solve_every_keyframes;
}

BundleProblem Mapper::PrepareSolve() {
  map_->SelectPiece(piece_);
  keyframes_since_solve_ = 0;
  solving_.clear();
  for (const WindowFrame& frame : window_.frames()) solving_.push_back(frame.id);
  return window_.BuildProblem();
}

bool Mapper::ApplySolve(const BundleResult& result) {
  map_->SelectPiece(piece_);
  const std::vector<std::int64_t> ids = std::move(solving_);
  solving_.clear();
  if (!result.usable()) return false;
  // Frames that have left the window since are part of the map as they stood, and stay there: what
  // the map shows and the trajectory says must not part.
  const std::int64_t first = window_.frames().front().id;
  if (ids.back() < first || window_.HoldAstray(ids, result.poses)) return false;
  MoveKeyframes(ids, result.poses);
  return true;
}

void Mapper::MoveKeyframes(const std::vector<std::int64_t>& ids, const std::vector<SE3>& poses) {
  const std::int64_t first = window_.frames().front().id;
  // Frames that have joined since move with the last one that was solved.
  const SE3 correction = poses.back() * open_.Keyframe(ids.back()).Inverse();
  rest_.Move(correction);
  for (std::size_t k = 0; k < ids.size(); ++k) {
    if (ids[k] >= first) open_.Keyframe(ids[k]) = poses[k];
  }
  for (std::int64_t id = ids.back() + 1; id < open_.NextKeyframe(); ++id) {
    open_.Keyframe(id) = correction * open_.Keyframe(id);
  }
  tracker_.odometry().Correct(correction);
  for (std::size_t i = 0; i < window_.frames().size(); ++i) {
    window_.SetPose(i, open_.Keyframe(first + static_cast<std::int64_t>(i)));
  }
  for (std::size_t i = 0; i < window_.frames().size(); ++i) {
    window_.Move(i, window_.frames()[i].T_world_lidar, window_.MotionAt(i));
  }
  open_.UpdateMotions();
  map_->Refresh();
}

void Mapper::SettleFirst() {
  constexpr std::size_t kEnough = 8;
  if (first_settled_ || start_.open() || !solving_.empty() || tracker_.lost() ||
      window_.frames().size() < kEnough)
    return;
  first_settled_ = true;
  const WindowFrame& first = window_.frames().front();
  // A first pose that is final already stays.
  if (!first.alone || open_.size() == 0 || open_.FirstMiddle().stamp_ns != first.stamp_ns) return;
  const std::vector<SE3> settled = FirstPosesByOthers(
      window_.frames(), tracker_.odometry().RecentInliers(), options_.frontend, options_.map);
  if (settled.empty()) return;
  // The first one stays where the piece begins, and the others move.
  const SE3 correction = first.T_world_lidar * settled.front().Inverse();
  std::vector<std::int64_t> ids;
  std::vector<SE3> poses;
  for (const WindowFrame& frame : window_.frames()) {
    const bool is_settled = ids.size() < settled.size();
    poses.push_back(correction * (is_settled ? settled[ids.size()] : frame.T_world_lidar));
    ids.push_back(frame.id);
  }
  poses.front() = first.T_world_lidar;
  for (std::size_t i = 1; i <= settled.size(); ++i)
    window_.SetMotionTo(i, poses[i - 1].Inverse() * poses[i]);
  MoveKeyframes(ids, poses);
  PlaceWindowAnew(kFewAstray);
}

void Mapper::PopOldest() {
  if (!on_final_keyframe_) {
    window_.PopOldest();
    return;
  }
  FinalKeyframe left;
  window_.PopOldest(&left);
  on_final_keyframe_(piece_, left);
}

Trajectory Mapper::TakeFinal(std::int64_t before_scan) {
  const Trajectory final_poses =
      open_.TakeFinal(window_.frames().empty() ? 0 : window_.frames().front().id, before_scan);
  before_start_ -= std::min(before_start_, final_poses.size());
  return final_poses;
}

std::vector<Eigen::Vector3d> Mapper::NewestKeyframe() const {
  std::vector<Eigen::Vector3d> points;
  if (window_.frames().empty()) return points;
  for (const PointCluster& cluster : window_.frames().back().in_map) points.push_back(cluster.mean);
  return points;
}

void Mapper::Archive(StateArchive& a) {
  a(&T_world_start_, &tracker_, &window_, &open_, &keyframes_since_solve_, &frames_since_keyframe_,
    &solving_, &start_, &stretch_, &ambiguous_, &matched_, &first_settled_, &resting_, &rest_,
    &before_start_);
}

}  // namespace lamina
