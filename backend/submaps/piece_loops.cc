#include "backend/submaps/piece_loops.h"

#include <algorithm>
#include <utility>

namespace lamina {

PieceLoops::PieceLoops(const LoopOptions& options, const MapperOptions& mapping)
    : options_(options), mapping_(mapping) {
  CheckOptions(options, "loops");
}

void PieceLoops::Add(std::int64_t piece, const FinalKeyframe& keyframe) {
  auto& closure = closures_[piece];
  if (closure == nullptr) {
    closure = std::make_unique<LoopClosure>(options_, mapping_.map, mapping_.odometry.matcher);
  }
  SubmapBuilder& builder =
      builders_.try_emplace(piece, options_.submap, mapping_.map.LeafSize()).first->second;
  if (auto submap = builder.Add(keyframe)) closure->Add(std::move(*submap));
}

void PieceLoops::Finish() {
  for (auto& [piece, builder] : builders_) {
    LoopClosure& closure = *closures_.at(piece);
    if (auto submap = builder.Finish()) closure.Add(std::move(*submap));
    corrections_.try_emplace(piece, closure.submaps(), closure.anchors());
  }
  builders_.clear();
}

bool PieceLoops::AnyAccepted() const {
  return std::any_of(closures_.begin(), closures_.end(), [](const auto& piece) {
    const auto& loops = piece.second->loops();
    return std::any_of(loops.begin(), loops.end(),
                       [](const Loop& loop) { return loop.status == Loop::Status::kAccepted; });
  });
}

SE3 PieceLoops::Corrected(const FinalPose& pose) const {
  const auto found = corrections_.find(pose.piece);
  if (found == corrections_.end()) return pose.pose.T_world_lidar;
  return found->second.Corrected(pose.pose.stamp_ns, pose.pose.T_world_lidar);
}

void PieceLoops::AddCorrectedTo(VoxelMap* map) const {
  for (const auto& [piece, closure] : closures_) {
    if (map->HasPiece(piece)) {
      map->SelectPiece(piece);
    } else {
      map->BeginPiece(piece);
    }
    AddToMap(closure->submaps(), closure->anchors(), map);
  }
}

}  // namespace lamina
