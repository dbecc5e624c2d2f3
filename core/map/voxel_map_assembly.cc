// The fixed part of a piece as a whole: exchanged for what was put together elsewhere, or erased.
#include <algorithm>
#include <utility>

#include "core/map/voxel_map.h"

namespace lamina {

void VoxelMap::ReplaceFixed(const std::vector<FixedPart>& parts) {
  // Refreshed and evicted so often: leaves of a few scans.
  constexpr std::size_t kBatch = 16384;
  const double reserve = 0.1 * options_.BudgetBytes();
  DropStored();
  DropFixed();
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const FixedPart& part = parts[i];
    if (!CanHold(part.cluster.mean)) continue;
    AddFixed(LeafAt(part.cluster.mean), part.cluster, part.frames, part.last_frame);
    if ((i + 1) % kBatch != 0) continue;
    Refresh();
    EvictFor(reserve, trees_.touches());
  }
  Refresh();
  EvictFor(reserve, trees_.touches());
  // Not added by a frame: no measure of what the next one may add.
  bytes_after_eviction_ = trees_.used_bytes();
}

void VoxelMap::ErasePiece(std::int64_t piece) {
  SelectPiece(piece);
  Refresh();
  DropStored();
  DropFixed();
  DropPiece(piece, {});
}

void VoxelMap::DropStored() {
  if (store_ == nullptr || store_->Empty()) return;
  std::vector<VoxelKey> tiles;
  store_->ForEachTile([&](VoxelKey tile) {
    if (SlotOf(tile) == slot_) tiles.push_back(tile);
  });
  std::sort(tiles.begin(), tiles.end());
  for (const VoxelKey tile : tiles) store_->Take(tile, [](std::string_view) {});
}

void VoxelMap::DropFixed() {
  for (NodeId root = trees_.oldest(); root != kNoNode;) {
    const NodeId next = trees_.newer(root);
    if (SlotOf(trees_.root(root).key) == slot_) {
      if (trees_.root(root).holds == 0) {
        snapshot_.BeforeChange(root, &trees_);
        RemoveRoot(root);
      } else {
        // The window knows its leaves by their nodes.
        Mark(root);
        DropFixedBelow(root);
      }
    }
    root = next;
  }
}

void VoxelMap::DropFixedBelow(NodeId id) {
  if (VoxelTrees::IsLeaf(id)) {
    trees_.leaf(id).fixed = PackedCluster();
    trees_.leaf(id).fixed_frames = 0;
    return;
  }
  const NodeId* const child = std::as_const(trees_).children(id);
  for (int slot = 0; slot < 8; ++slot) {
    if (child[slot] != kNoNode) DropFixedBelow(child[slot]);
  }
}

}  // namespace lamina
