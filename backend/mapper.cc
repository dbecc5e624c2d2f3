#include "backend/mapper.h"

#include <cmath>
#include <utility>

namespace lamina {

void BackendOptions::Visit(OptionVisitor& v) {
  v.Flag("enabled", &enabled);
  v.Integer("solve_every_keyframes", &solve_every_keyframes, 1, 1000);
  v.Integer("hand_over_lag_frames", &hand_over_lag_frames, 0, 100);
  v.Number("keyframe_translation_m", &keyframe_translation_m, 0.0, 100.0);
  v.Number("keyframe_rotation_deg", &keyframe_rotation_deg, 0.0, 180.0);
  v.Integer("restart_after_lost_frames", &restart_after_lost_frames, 0, 1000000);
  v.Integer("min_surfel_frames", &min_surfel_frames, 1, 1000);
  v.Group("window", &window);
  v.Group("solver", &solver);
}

Mapper::Mapper(const MapperOptions& options, std::function<void(const Surfel&)> on_evicted)
    : options_(options),
      map_(options.map),
      odometry_(options.odometry),
      window_(options.backend.window, &map_),
      on_evicted_(std::move(on_evicted)) {
  CheckOptions(options.backend, "backend");
}

MappedFrame Mapper::Process(StampNs stamp_ns, std::vector<TimedCluster> clusters) {
  MappedFrame result;
  result.odometry = Register(stamp_ns, clusters);
  OdometryFrame& frame = result.odometry;
  if (frame.status == OdometryFrame::Status::kLost) {
    result.restarted = ++lost_in_a_row_ > options_.backend.restart_after_lost_frames;
  }
  if (frame.status != OdometryFrame::Status::kLost || result.restarted) {
    lost_in_a_row_ = 0;
    odometry_.Accept(frame);
    result.keyframe = result.restarted || IsKeyframe(frame.T_world_lidar);
    if (result.keyframe) AddKeyframe(frame, std::move(clusters));
  }
  FrameRecord record;
  record.stamp_ns = stamp_ns;
  record.keyframe_id = static_cast<std::int64_t>(keyframes_.size()) - 1;
  record.T_keyframe_lidar = keyframes_.back().Inverse() * frame.T_world_lidar;
  records_.push_back(record);
  return result;
}

OdometryFrame Mapper::Register(StampNs stamp_ns, const std::vector<TimedCluster>& clusters) {
  OdometryFrame frame = odometry_.Register(stamp_ns, clusters, map_);
  const auto refine = [&] {
    return frame.status == OdometryFrame::Status::kTracked &&
           RefineLastTwist(stamp_ns, frame.T_world_lidar);
  };
  if (keyframes_.size() != 1) {
    refine();
    return frame;
  }
  // The first scan was put into the map as if the sensor stood still: one scan later its motion is
  // known, so both are brought to agree before anything is built on them.
  constexpr int kRounds = 4;
  for (int i = 0; i < kRounds && refine(); ++i) {
    map_.Refresh();
    frame = odometry_.Register(stamp_ns, clusters, map_);
  }
  return frame;
}

bool Mapper::IsKeyframe(const SE3& T) const {
  if (keyframes_.empty()) return true;
  const SE3& last = keyframes_.back();
  return (T.t - last.t).norm() >= options_.backend.keyframe_translation_m ||
         RotationAngle(last, T) >= options_.backend.keyframe_rotation_deg * M_PI / 180.0;
}

bool Mapper::RefineLastTwist(StampNs stamp_ns, const SE3& T_world_lidar) {
  if (window_.frames().empty() || window_.frames().back().measured.empty()) return false;
  const std::size_t last = window_.frames().size() - 1;
  const WindowFrame& frame = window_.frames()[last];
  const double dt = SecondsBetween(frame.stamp_ns, stamp_ns);
  if (dt <= 0.0 || dt > SlidingWindow::kMaxTwistGapS) return false;
  const Vector6d after = TwistLog(frame.T_world_lidar.Inverse() * T_world_lidar) / dt;
  const Vector6d twist = last == 0 ? after : Vector6d(0.5 * (window_.CentralTwist(last) + after));
  window_.Move(last, frame.T_world_lidar, twist);
  return true;
}

void Mapper::AddKeyframe(const OdometryFrame& odometry, std::vector<TimedCluster> clusters) {
  if (window_.full()) window_.PopOldest();
  WindowFrame frame;
  frame.id = static_cast<std::int64_t>(keyframes_.size());
  frame.stamp_ns = odometry.stamp_ns;
  frame.T_world_lidar = odometry.T_world_lidar;
  frame.twist = odometry.twist;
  frame.held = odometry.match.degenerate_directions;
  if (!keyframes_.empty())
    frame.T_previous_this = keyframes_.back().Inverse() * frame.T_world_lidar;
  frame.measured = std::move(clusters);
  keyframes_.push_back(frame.T_world_lidar);
  window_.Push(std::move(frame));
  map_.Refresh();
  map_.EvictToBudget(options_.backend.min_surfel_frames, on_evicted_);
  ++keyframes_since_solve_;
}

bool Mapper::SolvePossible() const {
  return options_.backend.enabled && solving_.empty() && window_.frames().size() >= 3;
}

bool Mapper::SolveDue() const {
  return SolvePossible() && keyframes_since_solve_ >= options_.backend.solve_every_keyframes;
}

BundleProblem Mapper::PrepareSolve() {
  keyframes_since_solve_ = 0;
  solving_.clear();
  for (const WindowFrame& frame : window_.frames()) solving_.push_back(frame.id);
  return window_.BuildProblem();
}

void Mapper::ApplySolve(const BundleResult& result) {
  const std::vector<std::int64_t> ids = std::move(solving_);
  solving_.clear();
  if (!result.usable()) return;
  // Frames that have left the window since are part of the map as they stood, and stay there: what
  // the map shows and the trajectory says must not part.
  const std::int64_t first = window_.frames().front().id;
  if (ids.back() < first) return;
  // Frames that have joined since move with the last one that was solved.
  const auto last = static_cast<std::size_t>(ids.back());
  const SE3 correction = result.poses.back() * keyframes_[last].Inverse();
  for (std::size_t k = 0; k < ids.size(); ++k) {
    if (ids[k] >= first) keyframes_[static_cast<std::size_t>(ids[k])] = result.poses[k];
  }
  for (std::size_t k = last + 1; k < keyframes_.size(); ++k) {
    keyframes_[k] = correction * keyframes_[k];
  }
  odometry_.Correct(correction);
  for (std::size_t i = 0; i < window_.frames().size(); ++i) {
    window_.SetPose(i, keyframes_[static_cast<std::size_t>(first) + i]);
  }
  for (std::size_t i = 0; i < window_.frames().size(); ++i) {
    window_.Move(i, window_.frames()[i].T_world_lidar, window_.CentralTwist(i));
  }
  map_.Refresh();
}

Trajectory Mapper::CurrentTrajectory() const {
  Trajectory trajectory;
  for (const FrameRecord& r : records_) {
    trajectory.push_back(
        {r.stamp_ns, keyframes_[static_cast<std::size_t>(r.keyframe_id)] * r.T_keyframe_lidar});
  }
  return trajectory;
}

}  // namespace lamina
