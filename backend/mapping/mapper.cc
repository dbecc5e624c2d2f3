#include "backend/mapping/mapper.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "backend/mapping/sweep_stamp.h"
#include "core/base/angle.h"
#include "core/base/error.h"

namespace lamina {

void BackendOptions::Visit(OptionVisitor& v) {
  v.Flag("enabled", &enabled);
  v.Integer("solve_every_keyframes", &solve_every_keyframes, 1, 1000);
  v.Integer("hand_over_lag_frames", &hand_over_lag_frames, 0, 100);
  v.Number("keyframe_translation_m", &keyframe_translation_m, 0.0, 100.0);
  v.Number("keyframe_rotation_deg", &keyframe_rotation_deg, 0.0, 180.0);
  v.Integer("keyframe_after_frames", &keyframe_after_frames, 0, 1000000);
  v.Integer("final_after_frames", &final_after_frames, 1, 1000000);
  v.Integer("restart_after_lost_frames", &restart_after_lost_frames, 0, 1000000);
  v.Integer("min_surfel_frames", &min_surfel_frames, 1, 1000);
  v.Group("window", &window);
  v.Group("solver", &solver);
}

void BackendOptions::CheckTogether() const {
  if (!enabled) return;
  const std::string frames = "backend.window.frames = " + std::to_string(window.frames);
  if (window.frames < kLeastSolved) {
    throw OptionError(frames + ": must be at least " + std::to_string(kLeastSolved) +
                      " while backend.enabled = true: bundle adjustment of fewer frames is never "
                      "begun");
  }
  if (hand_over_lag_frames >= window.frames) {
    throw OptionError(
        "backend.hand_over_lag_frames = " + std::to_string(hand_over_lag_frames) +
        ": must be less than " + frames +
        ": all frames of a solve could have left the window before its result takes effect");
  }
}

Mapper::Mapper(const MapperOptions& options, VoxelMap* map, std::int64_t piece,
               const SE3& T_world_start)
    : options_(options),
      map_(map),
      piece_(piece),
      T_world_start_(T_world_start),
      odometry_(options.odometry),
      window_(options.backend.window, map),
      lost_track_(options.odometry, options.map),
      start_(options.odometry, options.map) {
  CheckOptions(options.backend, "backend");
  options.backend.CheckTogether();
}

RegisteredScan Mapper::Process(const MapperScan& scan, bool may_restart) {
  const StampNs stamp_ns = scan.stamp_ns + scan.middle_ns;
  std::vector<TimedCluster>* const clusters = scan.clusters;
  RegisteredScan result;
  map_->SelectPiece(piece_);
  odometry_.TrustClock(!scan.stamp_made_up);
  if (odometry_.started()) RecallAround(odometry_.Predict(stamp_ns), *clusters);
  result.odometry = Register(stamp_ns, *clusters);
  OdometryFrame& frame = result.odometry;
  const bool started_over = start_.open() && FollowStart(scan, &frame);
  if (start_.given_up() && may_restart_ && may_restart) {
    matched_ = false;  // not as it should be: nothing of it is to stay
    result.to_restart = true;
    MoveToStamp(scan.middle_ns, &frame);
    return result;
  }
  if (frame.status == OdometryFrame::Status::kLost) {
    if (!odometry_.lost()) lost_track_.Add(stamp_ns, *clusters, frame.sweep.twist);
    odometry_.Lose();
    ++lost_in_a_row_;
    result.to_restart = may_restart_ && MayRestart() && may_restart;
    if (result.to_restart) {
      MoveToStamp(scan.middle_ns, &frame);
      return result;
    }
  } else {
    matched_ = matched_ || frame.status == OdometryFrame::Status::kTracked;
    lost_in_a_row_ = 0;
    odometry_.Accept(frame);
    if (lost_track_.scans() > 1) odometry_.Assume(lost_track_.Twist());
    if (started_over) odometry_.Assume(frame.sweep.twist);
    lost_track_.Clear();
    ++frames_since_keyframe_;
    result.keyframe = !localising_ && IsKeyframe(frame.T_world_lidar);
    if (result.keyframe) AddKeyframe(frame, std::move(*clusters));
  }
  // The last keyframe's clusters may have moved though nothing new entered the map.
  map_->Refresh();
  Open(scan, frame);
  MoveToStamp(scan.middle_ns, &frame);
  return result;
}

bool Mapper::FollowStart(const MapperScan& scan, OdometryFrame* frame) {
  // Only as long as all that the scans have left can be taken back.
  if (localising_ || window_.full() || open_.size() != start_.scans().size()) start_.Clear();
  if (!start_.open()) return false;
  start_.Add(*frame, scan.stamp_made_up, *scan.clusters);
  const bool overruled = start_.overruled();
  if (overruled) {
    StartOver(frame);
    start_.Clear();
  }
  frame->match.covariance += start_.Spread(frame->T_world_lidar);
  MatchResult& match = frame->match;
  if (start_.unsettled() && frame->status == OdometryFrame::Status::kTracked &&
      match.degenerate == 0) {
    match.degenerate = 1;
    match.degenerate_directions.col(0) = match.weakest_direction;
  }
  return overruled;
}

void Mapper::StartOver(OdometryFrame* frame) {
  map_->Refresh();
  DropWindow();
  map_->BeginPiece(piece_);
  window_ = SlidingWindow(options_.backend.window, map_);
  odometry_.StartOver();
  lost_track_.Clear();
  keyframes_.clear();
  keyframes_since_solve_ = frames_since_keyframe_ = 0;
  const StartTrack::Scan& first = start_.scans().front();
  start_.Move(FirstMiddle(first.twist) * first.T_world_lidar.Inverse());
  OdometryFrame taken;
  for (std::size_t k = 0; k < start_.scans().size(); ++k) {
    const StartTrack::Scan& scan = start_.scans()[k];
    taken.status = k == 0 ? OdometryFrame::Status::kFirst : OdometryFrame::Status::kTracked;
    taken.stamp_ns = scan.stamp_ns;
    taken.T_world_lidar = taken.T_world_predicted = scan.T_world_lidar;
    taken.sweep = scan.twist;
    if (k + 1 == start_.scans().size()) break;
    odometry_.Accept(scan.stamp_ns, scan.T_world_lidar);
    if (IsKeyframe(scan.T_world_lidar)) AddKeyframe(taken, scan.clusters);
    open_[k].keyframe_id = NextId() - 1;
    open_[k].T_keyframe_lidar = keyframes_.back().Inverse() * scan.T_world_lidar;
    open_[k].T_middle_stamp = AtStamp(scan.twist, open_[k].middle_ns);
  }
  taken.match = start_.match();
  taken.searched = true;
  *frame = taken;
}

OdometryFrame Mapper::FindAgain(StampNs stamp_ns, const std::vector<TimedCluster>& clusters) {
  lost_track_.Add(stamp_ns, clusters, odometry_.Twist(stamp_ns));
  // A scan that agrees with no other is worth a search or two; a long track one now and then.
  constexpr int kAlone = 3, kEach = 8, kThen = 5;
  const std::int64_t scans = lost_track_.scans();
  const bool search = scans > 1 ? scans <= kEach || scans % kThen == 0 : lost_in_a_row_ < kAlone;
  OdometryFrame frame = odometry_.FindAgain(stamp_ns, lost_track_, *map_, search);
  if (frame.match.status == MatchResult::Status::kConverged)
    lost_track_.Guess(frame.match.T_world_lidar);
  return frame;
}

bool Mapper::MayRestart() const {
  // After spray or a gap a few scans are needed to be found again; then the map does not have them.
  constexpr int kAgreeing = 5;
  const int after = options_.backend.restart_after_lost_frames;
  if (lost_track_.scans() < std::min(kAgreeing, after)) return false;
  if (options_.pieces_are_found && !odometry_.InReach(lost_track_.first_stamp_ns())) return true;
  return lost_in_a_row_ > after;
}

void Mapper::RecallAround(const SE3& T_world_lidar, const std::vector<TimedCluster>& clusters) {
  std::vector<Eigen::Vector3d> points;
  points.reserve(clusters.size());
  for (const TimedCluster& cluster : clusters)
    points.push_back(T_world_lidar * cluster.points.mean);
  map_->Recall(points);
}

OdometryFrame Mapper::Register(StampNs stamp_ns, const std::vector<TimedCluster>& clusters) {
  if (odometry_.lost()) return FindAgain(stamp_ns, clusters);
  OdometryFrame frame = odometry_.Register(stamp_ns, clusters, *map_, localising_);
  if (frame.status == OdometryFrame::Status::kFirst) frame.T_world_lidar = T_world_start_;
  const auto refine = [&] {
    return frame.status == OdometryFrame::Status::kTracked &&
           RefineLastTwist(stamp_ns, frame.T_world_lidar);
  };
  if (NextId() != 1) {
    refine();
    return frame;
  }
  // The first scan was put into the map as if the sensor stood still: one scan later its motion is
  // known, so both are brought to agree before anything is built on them.
  constexpr int kRounds = 4;
  for (int i = 0; i < kRounds && refine(); ++i) {
    MoveToStart(&frame);
    map_->Refresh();
    // The first scan is deskewed now: this one must be from the beginning, or lies off by the way
    // of half a sweep where the stamp is at its start.
    odometry_.Rematch(clusters, *map_, &frame);
  }
  return frame;
}

SE3 Mapper::FirstMiddle(const SweepMotion& sweep) const {
  return T_world_start_ * AtStamp(sweep, open_.front().middle_ns).Inverse();
}

void Mapper::MoveToStart(OdometryFrame* frame) {
  // A sensor that goes on in a map that was there before is where it was found.
  const WindowFrame& first = window_.frames().front();
  if (!first.alone || open_.empty() || open_.front().middle_ns == 0) return;
  // A first pose that is final already stays.
  if (MiddleOf(open_.front()).stamp_ns != first.stamp_ns) return;
  const SweepMotion sweep = first.sweep;
  const SE3 T_world_middle = FirstMiddle(sweep);
  const SE3 correction = T_world_middle * first.T_world_lidar.Inverse();
  window_.Move(0, T_world_middle, sweep);
  keyframes_.front() = T_world_middle;
  odometry_.Correct(correction);
  start_.Move(correction);
  for (SE3* T : {&frame->T_world_lidar, &frame->T_world_predicted, &frame->match.T_world_lidar})
    *T = correction * *T;
}

bool Mapper::IsKeyframe(const SE3& T) const {
  // The first ones wherever the sensor is: one that stands still makes a map, too, however short
  // the recording.
  if (keyframes_.empty() || NextId() < options_.backend.min_surfel_frames) return true;
  const int most = options_.backend.keyframe_after_frames;
  if (most > 0 && frames_since_keyframe_ >= most) return true;
  const SE3& last = keyframes_.back();
  return (T.t - last.t).norm() >= options_.backend.keyframe_translation_m ||
         RotationAngle(last, T) >= Radians(options_.backend.keyframe_rotation_deg);
}

bool Mapper::RefineLastTwist(StampNs stamp_ns, const SE3& T_world_lidar) {
  if (window_.frames().empty() || window_.frames().back().measured.empty()) return false;
  const std::size_t last = window_.frames().size() - 1;
  const WindowFrame& frame = window_.frames()[last];
  const double dt = SecondsBetween(frame.stamp_ns, stamp_ns);
  if (dt <= 0.0 || dt > SlidingWindow::kMaxTwistGapS) return false;
  const StampedPose next{stamp_ns, T_world_lidar};
  window_.Move(last, frame.T_world_lidar, window_.MotionAt(last, &next));
  return true;
}

void Mapper::AddKeyframe(const OdometryFrame& odometry, std::vector<TimedCluster> clusters) {
  if (window_.full()) PopOldest();
  WindowFrame frame;
  frame.id = NextId();
  frame.stamp_ns = odometry.stamp_ns;
  frame.T_world_lidar = odometry.T_world_lidar;
  frame.sweep = odometry.sweep;
  frame.alone = odometry.status != OdometryFrame::Status::kTracked;
  frame.held = odometry.match.degenerate_directions;
  frame.held_information = odometry.match.degenerate_information;
  if (!keyframes_.empty())
    frame.T_previous_this = keyframes_.back().Inverse() * frame.T_world_lidar;
  frame.measured = std::move(clusters);
  keyframes_.push_back(frame.T_world_lidar);
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
  if (ids.back() < first) return false;
  // Frames that have joined since move with the last one that was solved.
  const SE3 correction = result.poses.back() * Keyframe(ids.back()).Inverse();
  for (std::size_t k = 0; k < ids.size(); ++k) {
    if (ids[k] >= first) Keyframe(ids[k]) = result.poses[k];
  }
  for (std::int64_t id = ids.back() + 1; id < NextId(); ++id) {
    Keyframe(id) = correction * Keyframe(id);
  }
  odometry_.Correct(correction);
  for (std::size_t i = 0; i < window_.frames().size(); ++i) {
    window_.SetPose(i, Keyframe(first + static_cast<std::int64_t>(i)));
  }
  for (std::size_t i = 0; i < window_.frames().size(); ++i) {
    window_.Move(i, window_.frames()[i].T_world_lidar, window_.MotionAt(i));
  }
  map_->Refresh();
  return true;
}

void Mapper::StartLocalising(const SE3& T_world_lidar) {
  localising_ = true;
  may_restart_ = false;
  odometry_.StartAt(T_world_lidar);
}

void Mapper::StartLocalising(const Trajectory& last) {
  localising_ = true;
  AcceptLast(last);
}

void Mapper::Resume(const Trajectory& last, std::int64_t keyframe) {
  first_id_ = keyframe;
  matched_ = true;
  start_.Clear();
  AcceptLast(last);
}

void Mapper::AcceptLast(const Trajectory& last) {
  odometry_.StartOver();
  for (const StampedPose& pose : last) odometry_.Accept(pose.stamp_ns, pose.T_world_lidar);
}

void Mapper::Close() {
  map_->SelectPiece(piece_);
  if (!localising_ && !matched_) {
    DropWindow();
  } else {
    while (!window_.frames().empty()) PopOldest();
  }
  map_->Refresh();
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

void Mapper::TellWindow() const {
  if (!on_final_keyframe_) return;
  for (const FinalKeyframe& keyframe : WindowKeyframes()) on_final_keyframe_(piece_, keyframe);
}

std::vector<FinalKeyframe> Mapper::WindowKeyframes() const {
  std::vector<FinalKeyframe> keyframes;
  for (std::size_t i = 0; i < window_.frames().size(); ++i) keyframes.push_back(window_.AsFinal(i));
  return keyframes;
}

void Mapper::DropWindow() {
  std::vector<VoxelKey> roots;
  for (const WindowFrame& frame : window_.frames()) {
    for (std::size_t i = 0; i < frame.leaves.size(); ++i) {
      if (frame.leaves[i] != VoxelMap::kNoNode) roots.push_back(frame.addresses[i].root);
    }
  }
  map_->DropPiece(piece_, roots);
}

void Mapper::Open(const MapperScan& scan, const OdometryFrame& frame) {
  OpenFrame open{scan.number,         scan.stamp_ns,
                 scan.middle_ns,      OpenFrame::kNoKeyframe,
                 frame.T_world_lidar, AtStamp(frame.sweep, scan.middle_ns)};
  if (!localising_ && !keyframes_.empty()) {
    open.keyframe_id = NextId() - 1;
    open.T_keyframe_lidar = keyframes_.back().Inverse() * frame.T_world_lidar;
  }
  open_.push_back(open);
  if (open_.size() < 2 || frame.status != OdometryFrame::Status::kTracked) return;
  Trajectory poses;
  const std::size_t begin = open_.size() - std::min<std::size_t>(3, open_.size());
  for (std::size_t k = begin; k < open_.size(); ++k) poses.push_back(MiddleOf(open_[k]));
  const auto settle = [&](std::size_t k) {
    SweepMotion motion;
    if (MotionThrough(poses, k - begin, SlidingWindow::kMaxTwistGapS, &motion))
      open_[k].T_middle_stamp = AtStamp(motion, open_[k].middle_ns);
  };
  settle(open_.size() - 2);
  // The first of all has no pose before it, and is known better by the two after it.
  if (open_.size() == 3) settle(0);
}

StampedPose Mapper::MiddleOf(const OpenFrame& frame) const {
  const StampNs stamp_ns = frame.stamp_ns + frame.middle_ns;
  if (frame.keyframe_id == OpenFrame::kNoKeyframe) return {stamp_ns, frame.T_keyframe_lidar};
  return {stamp_ns, Keyframe(frame.keyframe_id) * frame.T_keyframe_lidar};
}

StampedPose Mapper::PoseOf(const OpenFrame& frame) const {
  return {frame.stamp_ns, MiddleOf(frame).T_world_lidar * frame.T_middle_stamp};
}

Trajectory Mapper::TakeFinal(std::int64_t before_scan) {
  Trajectory trajectory;
  const std::int64_t first = window_.frames().empty() ? 0 : window_.frames().front().id;
  while (!open_.empty() &&
         (open_.front().keyframe_id < first || open_.front().scan < before_scan)) {
    trajectory.push_back(PoseOf(open_.front()));
    open_.pop_front();
  }
  if (keyframes_.empty()) return trajectory;
  const std::int64_t needed = open_.empty() ? first : std::min(first, open_.front().keyframe_id);
  for (; first_id_ < needed; ++first_id_) keyframes_.pop_front();
  return trajectory;
}

Trajectory Mapper::OpenFrames() const {
  Trajectory trajectory;
  for (const OpenFrame& frame : open_) trajectory.push_back(PoseOf(frame));
  return trajectory;
}

std::vector<Eigen::Vector3d> Mapper::NewestKeyframe() const {
  std::vector<Eigen::Vector3d> points;
  if (window_.frames().empty()) return points;
  for (const PointCluster& cluster : window_.frames().back().in_map) points.push_back(cluster.mean);
  return points;
}

void Mapper::Archive(StateArchive& a) {
  a(&T_world_start_, &odometry_, &window_, &keyframes_, &first_id_, &keyframes_since_solve_,
    &frames_since_keyframe_, &solving_, &lost_in_a_row_, &lost_track_, &start_, &matched_,
    &localising_, &may_restart_);
  open_.resize(a.Size(open_.size(), 1));
  for (OpenFrame& frame : open_) {
    a(&frame.scan, &frame.stamp_ns, &frame.middle_ns, &frame.keyframe_id, &frame.T_keyframe_lidar,
      &frame.T_middle_stamp);
  }
}

}  // namespace lamina
