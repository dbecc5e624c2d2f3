// The budget of the map: what leaves memory, and what comes back.
#include <algorithm>

#include "core/map/voxel_map.h"

namespace lamina {

void VoxelMap::Return(std::string_view record) {
  const double before = trees_.used_bytes();
  StateArchive a(record);
  const NodeId root = LoadRoot(a);
  if (root == kNoNode) return;
  trees_.Link(root);
  trees_.Touch(root);
  MarkLoaded(root);
  // Not added by a frame: no measure of what the next one may add.
  bytes_after_eviction_ += trees_.used_bytes() - before;
}

std::size_t VoxelMap::Recall(const std::vector<Eigen::Vector3d>& points) {
  if (store_ == nullptr || store_->Empty()) return 0;
  const double reserve = 0.1 * options_.BudgetBytes();
  std::size_t recalled = 0;
  for (const Eigen::Vector3d& p : points) {
    if (!CanHold(p)) continue;
    const VoxelKey tile = TileOf(KeyOf(p));
    if (!store_->Has(tile)) continue;
    EvictFor(reserve, recent_touches_.front());
    if (!trees_.HasRoom(reserve, options_.BudgetBytes())) break;
    const std::size_t before = roots();
    store_->Take(tile, [this](std::string_view record) { Return(record); });
    recalled += roots() - before;
  }
  Refresh();
  bytes_after_eviction_ = trees_.used_bytes();
  return recalled;
}

std::size_t VoxelMap::bytes() const { return trees_.bytes() + marked_.capacity() * sizeof(NodeId); }

std::size_t VoxelMap::EvictToBudget() {
  // Blocks are never given back, they are filled again: so room must be made before memory would
  // grow over the budget, with a reserve for what the next frame may add: a twentieth or, where a
  // scan is much of a small budget, a little more than the last one added; and for the blocks that
  // are begun.
  const double added = trees_.used_bytes() - bytes_after_eviction_;
  const double reserve =
      std::max(0.05 * options_.BudgetBytes(), 1.25 * added) + VoxelTrees::kBlocksBytes;
  const std::size_t dropped = EvictFor(reserve, trees_.touches());
  bytes_after_eviction_ = trees_.used_bytes();
  std::rotate(recent_touches_.begin(), recent_touches_.begin() + 1, recent_touches_.end());
  recent_touches_.back() = trees_.touches();
  return dropped;
}

std::size_t VoxelMap::EvictFor(double reserve, std::uint64_t last_touch) {
  std::size_t dropped = 0;
  StateArchive record;
  NodeId root = trees_.oldest();
  while (root != kNoNode && trees_.root(root).touched <= last_touch &&
         !trees_.HasRoom(reserve, options_.BudgetBytes())) {
    const NodeId next = trees_.newer(root);
    const VoxelKey key = trees_.root(root).key;
    if (trees_.root(root).holds == 0 && trees_.root(root).marked == 0) {
      snapshot_.BeforeChange(root, &trees_);
      if (store_ != nullptr) {
        record.written().clear();
        trees_.Save(record, root);
        store_->Put(TileOf(key), key, record.written());
      }
      RemoveRoot(root);
      ++dropped;
    }
    root = next;
  }
  return dropped;
}

}  // namespace lamina
