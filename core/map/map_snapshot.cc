#include "core/map/map_snapshot.h"

namespace lamina {

void MapSnapshot::Begin(const VoxelTrees& trees) {
  ++number_;
  under_way_ = true;
  next_ = trees.oldest();
  records_.written().clear();
}

void MapSnapshot::Save(NodeId root, VoxelTrees* trees) {
  trees->root(root).snapshot = number_;
  trees->Save(records_, root);
}

bool MapSnapshot::Continue(std::size_t bytes, VoxelTrees* trees, std::string* records) {
  std::string& saved = records_.written();
  // Or growing by doubling would take three times as much.
  saved.reserve(bytes + bytes / 16);
  while (next_ != kNoNode && saved.size() < bytes) {
    const NodeId root = next_;
    next_ = trees->newer(root);
    if (trees->root(root).snapshot != number_) Save(root, trees);
  }
  under_way_ = next_ != kNoNode;
  records->swap(saved);
  saved.clear();
  return under_way_;
}

}  // namespace lamina
