// The map beyond its memory: what is saved and loaded, and what is read back for show.
#include <algorithm>

#include "core/map/voxel_map.h"

namespace lamina {

VoxelMap::NodeId VoxelMap::LoadRoot(StateArchive& a) {
  const NodeId root = trees_.Load(a);
  if (root == kNoNode) return kNoNode;
  if (static_cast<std::size_t>(SlotOf(trees_.root(root).key)) >= pieces_.size()) {
    throw InputError("a saved voxel is of no piece of the map");
  }
  trees_.root(root).snapshot = snapshot_.number();
  return root;
}

void VoxelMap::BeginSnapshot() { snapshot_.Begin(trees_); }

bool VoxelMap::ContinueSnapshot(std::size_t bytes, std::string* records) {
  return snapshot_.Continue(bytes, &trees_, records);
}

void VoxelMap::ArchiveCounters(StateArchive& a) {
  trees_.ArchiveCounters(a);
  a(&bytes_after_eviction_, &pieces_);
  for (std::uint64_t& touches : recent_touches_) a(&touches);
}

void VoxelMap::Load(std::string_view records) {
  StateArchive a(records);
  while (a.unread() > 0) {
    const NodeId root = LoadRoot(a);
    if (root != kNoNode) MarkLoaded(root);
  }
}

void VoxelMap::FinishLoading() {
  std::sort(marked_.begin(), marked_.end(),
            [this](NodeId a, NodeId b) { return trees_.root(a).touched < trees_.root(b).touched; });
  for (const NodeId root : marked_) trees_.Link(root);
  Refresh();
}

VoxelMap::NodeId VoxelMap::LeafOf(const LeafAddress& address) const {
  NodeId id = trees_.FindRoot(address.root);
  for (int level = trees_.levels() - 1; level >= 0 && id != kNoNode; --level) {
    id = trees_.children(id)[VoxelTrees::SlotOfPath(address.path, level)];
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
  for (NodeId root = trees_.oldest(); root != kNoNode; root = trees_.newer(root)) {
    VisitRoot(root, min_frames, visit);
  }
  if (store_ == nullptr || store_->Empty()) return;
  RecordSurfaces stored(*this, min_frames, visit);
  store_->ShowAll([&](std::string_view record) { stored.Add(record); });
  stored.Show();
}

std::vector<VoxelMap::NodeId> VoxelMap::RootsOfTile(VoxelKey tile) const {
  constexpr int kEdge = 1 << kTileBits;
  std::vector<NodeId> roots;
  for (int i = 0; i < kEdge * kEdge * kEdge; ++i) {
    const NodeId root =
        trees_.FindRoot(VoxelOfTile(tile, i / kEdge / kEdge, i / kEdge % kEdge, i % kEdge));
    if (root != kNoNode) roots.push_back(root);
  }
  return roots;
}

void VoxelMap::VisitLeaves(const VoxelTrees& trees, NodeId root, const VisitLeaf& visit) {
  const Eigen::Vector3d centre = trees.CentreOf(root);
  trees.ForEachLeaf(root, [&](const MapLeaf& leaf) {
    ClusterMoments sum = leaf.fixed.Moments();
    if (const ClusterMoments* window = trees.FindWindow(leaf)) sum += *window;
    if (!sum.Empty()) visit(sum.Cluster(centre), leaf.fixed_frames + leaf.window_frames);
  });
}

void VoxelMap::ForEachLeafOfTile(VoxelKey tile, const VisitLeaf& visit) const {
  for (const NodeId root : RootsOfTile(tile)) VisitLeaves(trees_, root, visit);
  if (store_ == nullptr || !store_->Has(tile)) return;
  VoxelTrees trees(options_.root_size_m, options_.depth);
  store_->Show(tile, [&](std::string_view record) {
    StateArchive a(record);
    VisitLeaves(trees, trees.Load(a), visit);
  });
}

std::int64_t VoxelMap::ForEachSurfaceOfTile(VoxelKey tile, std::int64_t changed_by, int min_frames,
                                            const VisitSurfel& visit) const {
  const std::vector<NodeId> roots = RootsOfTile(tile);
  std::int64_t changed = 0;
  for (const NodeId root : roots)
    changed = std::max(changed, std::int64_t{trees_.root(root).refreshed});
  if (changed <= changed_by) return changed;
  for (const NodeId root : roots) VisitRoot(root, min_frames, visit);
  if (store_ == nullptr || !store_->Has(tile)) return changed;
  RecordSurfaces stored(*this, min_frames, visit);
  store_->Show(tile, [&](std::string_view record) { stored.Add(record); });
  stored.Show();
  return changed;
}

}  // namespace lamina
