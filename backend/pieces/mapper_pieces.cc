// How a piece of the map ends, what it leaves, and how the next one goes on from it.
#include <utility>

#include "backend/pieces/mapper.h"

namespace lamina {

PieceEnd Mapper::EndOfPiece(const MapperScan& scan, const OdometryFrame& frame, bool may_restart) {
  if (start_.given_up() && may_restart) {
    matched_ = false;  // Close() is to keep nothing of it
    return PieceEnd::kUnconnected;
  }
  stretch_.Follow(frame, tracker_.odometry().motion(), *scan.clusters, *map_, window_,
                  open_.NextKeyframe());
  // As long as the start is open, all of its scans together say where they are.
  if (!start_.open()) {
    ambiguous_.Follow(frame, tracker_.odometry().motion(), *scan.clusters, *map_, window_,
                      open_.NextKeyframe());
    if (EndsInOpen(may_restart)) return PieceEnd::kContinued;
  }
  if (frame.status != OdometryFrame::Status::kLost) return PieceEnd::kNone;
  tracker_.Lose(frame, *scan.clusters);
  const bool restarts = tracker_.MayRestart(matched_) || tracker_.LostLongerThanTracked();
  return may_restart && restarts ? PieceEnd::kUnconnected : PieceEnd::kNone;
}

bool Mapper::EndsInOpen(bool may_restart) {
  const double most = options_.backend.restart_after_sigma_m;
  may_restart = may_restart && most > 0.0;
  if (stretch_.over()) {
    if (may_restart && stretch_.SigmaM() > most) return true;
    stretch_.Forget();
  }
  if (ambiguous_.over()) {
    if (may_restart) return true;
    ambiguous_.Forget();
  }
  return false;
}

std::vector<WindowFrame> Mapper::SettledFrames() const {
  const std::int64_t first =
      stretch_.over() ? stretch_.settled_keyframe() : ambiguous_.first_keyframe();
  std::vector<WindowFrame> settled;
  for (const WindowFrame& frame : window_.frames()) {
    if (frame.id < first) continue;
    WindowFrame& copy = settled.emplace_back();
    copy.stamp_ns = frame.stamp_ns;
    copy.T_world_lidar = frame.T_world_lidar;
    copy.sweep = frame.sweep;
    copy.T_previous_this = frame.T_previous_this;
    copy.measured = frame.measured;
    if (!copy.measured.empty()) continue;
    for (const PointCluster& cluster : frame.deskewed)
      copy.measured.emplace_back().points = cluster;
  }
  return settled;
}

void Mapper::GoOnFrom(const Mapper& before, std::vector<WindowFrame> frames) {
  tracker_.GoOnFrom(before.tracker_);
  start_.Clear();
  for (const WindowFrame& frame : frames) {
    const Eigen::Vector3d way = frame.T_world_lidar.t - frames.front().T_world_lidar.t;
    if (way.norm() > RestAtStart::kRestsM) rest_.End();
  }
  map_->SelectPiece(piece_);
  for (WindowFrame& frame : frames) {
    frame.id = open_.NextKeyframe();
    open_.AddKeyframe(frame.T_world_lidar);
    window_.Push(std::move(frame));
  }
  map_->Refresh();
}

void Mapper::Resume(const Trajectory& last, std::int64_t keyframe) {
  open_.CountFrom(keyframe);
  matched_ = true;
  ClearStart();
  tracker_.StartAfter(last);
}

void Mapper::Close() {
  map_->SelectPiece(piece_);
  if (!matched_) {
    DropWindow();
  } else {
    while (!window_.frames().empty()) PopOldest();
  }
  map_->Refresh();
}

void Mapper::EmitWindowKeyframes() const {
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

}  // namespace lamina
