// Roots of the voxel map as records of bytes: snapshots, what the store keeps, addresses of leaves.
//
// A record, little-endian (core/geometry/state_archive.h):
//
//     u64 key of the root    u64 number of its last touch    its tree
//
// and a tree is, for an inner node, a u8 with a bit for each child that is there, followed by the
// trees of these; for a leaf
//
//     u16 fixed_frames   u16 window_frames   i32 last_added   i32 last_fixed
//     u8 bits: 1 it has a fixed cluster, 2 a window cluster; each 10 f64: count, mean, scatter
//
// Surfaces follow from the clusters and are made again. Holds are for the window to repeat.
#include <algorithm>

#include "core/map/voxel_map.h"

namespace lamina {

void VoxelMap::ArchiveTree(StateArchive& a, NodeId id, int level) {
  Node& n = node(id);
  if (level == options_.depth) {
    a(&n.fixed_frames, &n.window_frames, &n.last_added, &n.last_fixed);
    auto parts =
        static_cast<std::uint8_t>((n.fixed.count > 0.0 ? 1 : 0) | (n.window.count > 0.0 ? 2 : 0));
    a(&parts);
    if ((parts & 1) != 0) a(&n.fixed);
    if ((parts & 2) != 0) a(&n.window);
    return;
  }
  std::uint8_t children = 0;
  for (int slot = 0; slot < 8; ++slot) {
    if (n.child[slot] != kNoNode) children = static_cast<std::uint8_t>(children | (1U << slot));
  }
  a(&children);
  for (int slot = 0; slot < 8; ++slot) {
    if ((children & (1U << slot)) == 0) continue;
    if (a.reading()) {
      const NodeId child = NewNode(id);
      n.child[slot] = child;
    }
    ArchiveTree(a, n.child[slot], level + 1);
  }
}

void VoxelMap::ArchiveRoot(StateArchive& a, NodeId root) {
  a(&node(root).key, &node(root).touched);
  ArchiveTree(a, root, 0);
}

VoxelMap::NodeId VoxelMap::LoadRoot(StateArchive& a) {
  const NodeId root = NewNode(kNoNode);
  try {
    ArchiveRoot(a, root);
    if (static_cast<std::size_t>(SlotOf(node(root).key)) >= pieces_.size()) {
      throw InputError("a saved voxel is of no piece of the map");
    }
  } catch (const InputError&) {
    FreeTree(root);
    throw;
  }
  if (index_.FindOrInsert(node(root).key, root) == root) return root;
  FreeTree(root);
  return kNoNode;
}

void VoxelMap::Return(std::string_view record) {
  const std::size_t before = UsedBytes();
  StateArchive a(record);
  const NodeId root = LoadRoot(a);
  if (root == kNoNode) return;
  Touch(root);
  MarkRoot(root);
  // Not added by a frame: no measure of what the next one may add.
  bytes_after_eviction_ += UsedBytes() - before;
}

std::size_t VoxelMap::Recall(const std::vector<Eigen::Vector3d>& points) {
  if (store_ == nullptr || store_->Empty()) return 0;
  const double room = 0.9 * options_.BudgetBytes();
  std::size_t recalled = 0;
  for (const Eigen::Vector3d& p : points) {
    if (!CanHold(p)) continue;
    const VoxelKey tile = TileOf(KeyOf(p));
    if (!store_->Has(tile)) continue;
    EvictTo(room, recent_touches_.front());
    if (static_cast<double>(UsedBytes()) > room) break;
    const std::size_t before = roots();
    store_->Take(tile, [this](std::string_view record) { Return(record); });
    recalled += roots() - before;
  }
  Refresh();
  bytes_after_eviction_ = UsedBytes();
  return recalled;
}

void VoxelMap::BeginSnapshot() {
  ++snapshot_;
  snapshot_under_way_ = true;
  snapshot_next_ = oldest_;
  snapshot_records_.written().clear();
}

void VoxelMap::SaveRoot(NodeId root) {
  node(root).snapshot = snapshot_;
  ArchiveRoot(snapshot_records_, root);
}

bool VoxelMap::ContinueSnapshot(std::size_t bytes, std::string* records) {
  std::string& saved = snapshot_records_.written();
  // Or growing by doubling would take three times as much.
  saved.reserve(bytes + bytes / 16);
  while (snapshot_next_ != kNoNode && saved.size() < bytes) {
    const NodeId root = snapshot_next_;
    snapshot_next_ = node(root).newer;
    if (node(root).snapshot != snapshot_) SaveRoot(root);
  }
  snapshot_under_way_ = snapshot_next_ != kNoNode;
  records->swap(saved);
  saved.clear();
  return snapshot_under_way_;
}

void VoxelMap::ArchiveCounters(StateArchive& a) {
  std::uint64_t after_eviction = bytes_after_eviction_;
  std::uint64_t index_size = index_.expected_size();
  a(&after_eviction, &touches_, &index_size, &pieces_);
  if (a.reading()) index_ = VoxelIndex(static_cast<std::size_t>(index_size));
  for (std::uint64_t& touches : recent_touches_) a(&touches);
  bytes_after_eviction_ = static_cast<std::size_t>(after_eviction);
}

void VoxelMap::Load(std::string_view records) {
  StateArchive a(records);
  while (a.unread() > 0) {
    const NodeId root = LoadRoot(a);
    if (root != kNoNode) marked_.push_back(root);
  }
}

void VoxelMap::FinishLoading() {
  std::sort(marked_.begin(), marked_.end(),
            [this](NodeId a, NodeId b) { return node(a).touched < node(b).touched; });
  for (const NodeId root : marked_) LinkNewest(root);
  Refresh();
}

VoxelMap::NodeId VoxelMap::LeafOf(const LeafAddress& address) const {
  NodeId id = index_.Find(address.root);
  for (int level = options_.depth - 1; level >= 0 && id != kNoNode; --level) {
    id = node(id).child[(address.path >> (3 * level)) & 7U];
  }
  return id;
}

// Shows surfaces of records, some hundred at a time, by means of a map of their own.
class VoxelMap::RecordSurfaces {
 public:
  RecordSurfaces(const VoxelMap& map, int min_frames, const VoxelMap::VisitSurfel& visit)
      : map_(map), min_frames_(min_frames), visit_(visit) {}

  void Add(std::string_view record) {
    records_.append(record);
    constexpr std::size_t kBatchBytes = 1 << 20;
    if (records_.size() > kBatchBytes) Show();
  }
  void Show() {
    VoxelMap map(map_.options_);
    map.pieces_ = map_.pieces_;
    map.Load(records_);
    map.FinishLoading();
    map.ForEachSurface(min_frames_, visit_);
    records_.clear();
  }

 private:
  const VoxelMap& map_;
  const int min_frames_;
  const VoxelMap::VisitSurfel& visit_;
  std::string records_;
};

void VoxelMap::ForEachSurface(int min_frames, const VisitSurfel& visit) const {
  for (NodeId root = oldest_; root != kNoNode; root = node(root).newer) {
    VisitRoot(root, min_frames, visit);
  }
  if (store_ == nullptr || store_->Empty()) return;
  RecordSurfaces stored(*this, min_frames, visit);
  store_->ShowAll([&](std::string_view record) { stored.Add(record); });
  stored.Show();
}

std::int64_t VoxelMap::ForEachSurfaceOfTile(VoxelKey tile, std::int64_t changed_by, int min_frames,
                                            const VisitSurfel& visit) const {
  constexpr int kEdge = 1 << kTileBits;
  std::vector<NodeId> roots;
  std::int64_t changed = 0;
  for (int i = 0; i < kEdge * kEdge * kEdge; ++i) {
    const NodeId root =
        index_.Find(VoxelOfTile(tile, i / kEdge / kEdge, i / kEdge % kEdge, i % kEdge));
    if (root == kNoNode) continue;
    roots.push_back(root);
    changed = std::max(changed, std::int64_t{node(root).refreshed});
  }
  if (changed <= changed_by) return changed;
  for (const NodeId root : roots) VisitRoot(root, min_frames, visit);
  if (store_ == nullptr || !store_->Has(tile)) return changed;
  RecordSurfaces stored(*this, min_frames, visit);
  store_->Show(tile, [&](std::string_view record) { stored.Add(record); });
  stored.Show();
  return changed;
}

}  // namespace lamina
