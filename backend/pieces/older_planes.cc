#include "backend/pieces/older_planes.h"

#include <algorithm>

namespace lamina {

OlderPlanes::OlderPlanes(const VoxelMap& map, const SlidingWindow& window,
                         std::int64_t first_keyframe)
    : map_(map),
      first_keyframe_(first_keyframe),
      points_per_frame_(map.options().max_cluster_weight) {
  for (const WindowFrame& frame : window.frames()) {
    if (frame.id < first_keyframe) continue;
    for (std::size_t i = 0; i < frame.leaves.size(); ++i) {
      if (frame.leaves[i] == VoxelMap::kNoNode) continue;
      const VoxelMap::NodeId plane = map.PlaneAbove(frame.leaves[i]);
      Newer& newer = newer_[plane == VoxelMap::kNoNode ? frame.leaves[i] : plane];
      newer.cluster += frame.in_map[i];
      newer.frames += newer.last_frame != frame.id ? 1 : 0;
      newer.last_frame = frame.id;
    }
  }
}

OlderPlanes::Older OlderPlanes::Make(VoxelMap::NodeId surface) const {
  PointCluster cluster = map_.Aggregate(surface);
  int frames = map_.frames(surface);
  const auto newer = newer_.find(surface);
  if (newer != newer_.end()) {
    // If all frames are newer, what is left is rounding, and no plane.
    if (newer->second.frames >= frames) return {};
    cluster -= newer->second.cluster;
    frames -= newer->second.frames;
  }
  const double fixed_since = map_.FixedSince(surface, first_keyframe_, points_per_frame_);
  const double share = 1.0 - fixed_since / std::max(cluster.count, 1e-9);
  if (share <= 0.0) return {};
  return {map_.SurfaceOf(cluster, frames), share * share};
}

WeightedPlane OlderPlanes::Of(VoxelMap::NodeId surface) {
  const auto [found, is_new] = planes_.try_emplace(surface);
  if (is_new) found->second = Make(surface);
  const Older& older = found->second;
  if (older.surface.kind != Surface::Kind::kPlane) return {};
  return {&older.surface, older.weight};
}

}  // namespace lamina
