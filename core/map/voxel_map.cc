#include "core/map/voxel_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "core/base/parallel.h"

namespace lamina {
namespace {

// Which child of a cube around `centre` holds p, and where that child's centre lies.
inline int ChildSlot(const Eigen::Vector3d& p, double child_half_size, Eigen::Vector3d* centre) {
  int slot = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const bool upper = p(axis) >= (*centre)(axis);
    slot |= static_cast<int>(upper) << axis;
    (*centre)(axis) += upper ? child_half_size : -child_half_size;
  }
  return slot;
}

inline std::uint16_t SaturatingAdd(std::uint16_t a, int b) {
  constexpr int kMost = std::numeric_limits<std::uint16_t>::max();
  return static_cast<std::uint16_t>(std::min(kMost, static_cast<int>(a) + b));
}

void CapWeight(double most, PointCluster* cluster) {
  if (cluster->count > most) *cluster = cluster->Scaled(most / cluster->count);
}

}  // namespace

void VoxelMapOptions::Visit(OptionVisitor& v) {
  v.Number("root_size_m", &root_size_m, 0.05, 20.0);
  v.Integer("depth", &depth, 0, 4);
  v.Integer("min_points", &min_points, 4, 10000);
  v.Number("max_thickness_m", &max_thickness_m, 1e-4, 10.0);
  v.Number("max_flatness", &max_flatness, 1e-6, 1.0);
  v.Number("min_breadth", &min_breadth, 0.0, 1.0);
  v.Number("max_fixed_weight", &max_fixed_weight, 1.0, 1e9);
  v.Number("budget_mb", &budget_mb, 1.0, 1e6);
}

VoxelMap::VoxelMap(const VoxelMapOptions& options, VoxelStore* store)
    : options_(options), inverse_root_size_(1.0 / options.root_size_m), store_(store) {
  CheckOptions(options, "map");
}

int VoxelMap::SlotOfPiece(std::int64_t piece) const {
  const auto at = std::find(pieces_.begin(), pieces_.end(), piece);
  if (piece >= 0 && at != pieces_.end()) return static_cast<int>(at - pieces_.begin());
  throw std::logic_error("the map has no piece " + std::to_string(piece));
}

void VoxelMap::SelectPiece(std::int64_t piece) {
  if (selected_piece() != piece) slot_ = SlotOfPiece(piece);
}

bool VoxelMap::HasPiece(std::int64_t piece) const {
  return piece >= 0 && std::find(pieces_.begin(), pieces_.end(), piece) != pieces_.end();
}

bool VoxelMap::RoomForPiece() const {
  return pieces_.size() < kMostSlots ||
         std::find(pieces_.begin(), pieces_.end(), kNoPiece) != pieces_.end();
}

void VoxelMap::BeginPiece(std::int64_t piece) {
  const auto free = std::find(pieces_.begin(), pieces_.end(), kNoPiece);
  slot_ = static_cast<int>(free - pieces_.begin());
  if (free == pieces_.end()) pieces_.push_back(kNoPiece);
  pieces_[static_cast<std::size_t>(slot_)] = piece;
}

void VoxelMap::DropPiece(std::int64_t piece, const std::vector<VoxelKey>& roots) {
  for (const VoxelKey key : roots) {
    const NodeId root = index_.Find(key);
    if (root == kNoNode) continue;
    BeforeChange(root);
    RemoveRoot(root);
  }
  pieces_[static_cast<std::size_t>(SlotOfPiece(piece))] = kNoPiece;
}

void VoxelMap::RemoveRoot(NodeId root) {
  index_.Erase(node(root).key);
  Unlink(root);
  FreeTree(root);
}

VoxelMap::NodeId VoxelMap::NewNode(NodeId parent) {
  NodeId id = free_list_;
  if (id != kNoNode) {
    free_list_ = node(id).parent;
  } else {
    id = next_unused_++;
    if ((id & kBlockMask) == 0) blocks_.push_back(std::make_unique<Node[]>(kBlockMask + 1));
  }
  Node& n = node(id);
  n = Node();
  std::fill(std::begin(n.child), std::end(n.child), kNoNode);
  n.parent = parent;
  n.snapshot = snapshot_;
  ++used_nodes_;
  return id;
}

void VoxelMap::FreeTree(NodeId id) {
  Node& n = node(id);
  for (const NodeId child : n.child) {
    if (child != kNoNode) FreeTree(child);
  }
  n.parent = free_list_;
  free_list_ = id;
  --used_nodes_;
}

VoxelMap::NodeId VoxelMap::RootOf(NodeId id) const {
  while (node(id).parent != kNoNode) id = node(id).parent;
  return id;
}

VoxelMap::NodeId VoxelMap::FindSurface(const Eigen::Vector3d& p) const {
  const VoxelKey key = KeyOf(p);
  NodeId id = index_.Find(key);
  if (id == kNoNode || node(id).surface.kind == Surface::Kind::kPlane) return id;
  Eigen::Vector3d centre = RootCentre(key, options_.root_size_m);
  double half = 0.25 * options_.root_size_m;
  for (int level = 0; level < options_.depth; ++level, half *= 0.5) {
    id = node(id).child[ChildSlot(p, half, &centre)];
    if (id == kNoNode || node(id).surface.kind == Surface::Kind::kPlane) return id;
  }
  return id;
}

VoxelMap::NodeId VoxelMap::PlaneAbove(NodeId leaf) const {
  NodeId best = kNoNode;
  for (NodeId id = leaf; id != kNoNode; id = node(id).parent) {
    if (node(id).surface.kind == Surface::Kind::kPlane) best = id;
  }
  return best;
}

PointCluster VoxelMap::Aggregate(NodeId id) const {
  const Node& n = node(id);
  PointCluster sum = n.fixed;
  sum += n.window;
  for (const NodeId child : n.child) {
    if (child != kNoNode) sum += Aggregate(child);
  }
  return sum;
}

PointCluster VoxelMap::FixedAggregate(NodeId id) const {
  const Node& n = node(id);
  PointCluster sum = n.fixed;
  for (const NodeId child : n.child) {
    if (child != kNoNode) sum += FixedAggregate(child);
  }
  return sum;
}

VoxelMap::NodeId VoxelMap::LeafAt(const Eigen::Vector3d& p, LeafAddress* address) {
  const VoxelKey key = KeyOf(p);
  NodeId id = index_.Find(key);
  if (id == kNoNode && store_ != nullptr && store_->Has(TileOf(key))) {
    store_->TakeRoot(TileOf(key), key, [this](std::string_view record) { Return(record); });
    id = index_.Find(key);
  }
  if (id == kNoNode) {
    id = NewNode(kNoNode);
    node(id).key = key;
    index_.FindOrInsert(key, id);
  } else {
    BeforeChange(id);
    Unlink(id);
  }
  Touch(id);
  Eigen::Vector3d centre = RootCentre(key, options_.root_size_m);
  std::uint64_t path = 0;
  double half = 0.25 * options_.root_size_m;
  for (int level = 0; level < options_.depth; ++level, half *= 0.5) {
    const int slot = ChildSlot(p, half, &centre);
    path = path << 3 | static_cast<std::uint64_t>(slot);
    NodeId next = node(id).child[slot];
    if (next == kNoNode) {
      next = NewNode(id);
      node(id).child[slot] = next;
    }
    id = next;
  }
  if (address != nullptr) *address = {key, path};
  return id;
}

void VoxelMap::Unlink(NodeId root) {
  Node& n = node(root);
  if (snapshot_next_ == root) snapshot_next_ = n.newer;
  (n.older == kNoNode ? oldest_ : node(n.older).newer) = n.newer;
  (n.newer == kNoNode ? newest_ : node(n.newer).older) = n.older;
}

void VoxelMap::LinkNewest(NodeId root) {
  Node& n = node(root);
  n.older = newest_;
  n.newer = kNoNode;
  (newest_ == kNoNode ? oldest_ : node(newest_).newer) = root;
  newest_ = root;
}

void VoxelMap::Mark(NodeId leaf) {
  const NodeId root = RootOf(leaf);
  BeforeChange(root);
  MarkRoot(root);
}

void VoxelMap::MarkRoot(NodeId root) {
  if (node(root).marked) return;
  node(root).marked = true;
  marked_.push_back(root);
}

void VoxelMap::AddWindow(NodeId leaf, const PointCluster& cluster, std::int64_t frame) {
  Mark(leaf);
  Node& n = node(leaf);
  n.window += cluster;
  if (n.last_added != frame) n.window_frames = SaturatingAdd(n.window_frames, 1);
  n.last_added = static_cast<std::int32_t>(frame);
}

void VoxelMap::ReplaceWindow(NodeId leaf, const PointCluster& before, const PointCluster& after) {
  Mark(leaf);
  Node& n = node(leaf);
  n.window -= before;
  n.window += after;
}

void VoxelMap::FixWindow(NodeId leaf, const PointCluster& cluster, double weight,
                         std::int64_t frame) {
  Mark(leaf);
  Node& n = node(leaf);
  if (n.last_fixed != frame) {
    n.fixed_frames = SaturatingAdd(n.fixed_frames, 1);
    n.window_frames = static_cast<std::uint16_t>(n.window_frames - 1);
  }
  n.last_fixed = static_cast<std::int32_t>(frame);
  n.window -= cluster;
  n.fixed += cluster.Scaled(weight);
  CapWeight(options_.max_fixed_weight, &n.fixed);
}

void VoxelMap::AddFixed(NodeId leaf, const PointCluster& cluster, int frames,
                        std::int64_t last_frame) {
  Mark(leaf);
  Node& n = node(leaf);
  n.last_added = std::max(n.last_added, static_cast<std::int32_t>(last_frame));
  n.fixed_frames = SaturatingAdd(n.fixed_frames, frames);
  n.fixed += cluster;
  CapWeight(options_.max_fixed_weight, &n.fixed);
}

void VoxelMap::Hold(NodeId leaf) { ++node(RootOf(leaf)).holds; }

void VoxelMap::Release(NodeId leaf) { --node(RootOf(leaf)).holds; }

Surface VoxelMap::SurfaceOf(const PointCluster& cluster, int frames) const {
  Surface s;
  s.mean = cluster.mean;
  s.frames = SaturatingAdd(0, frames);
  if (cluster.count < options_.min_points) return s;
  const Eigen3 eigen = cluster.Eigen();
  s.kind = Surface::Kind::kRough;
  constexpr double kLeastVariance = 1e-8;  // m^2, so that the breadth follows from the flatness
  s.variance = static_cast<float>(std::max(kLeastVariance, eigen.l(2)));
  if (eigen.l(1) > 0.0) s.flatness = s.variance / static_cast<float>(eigen.l(1));
  s.normal = eigen.u.col(2).cast<float>();
  const double thickness2 = options_.max_thickness_m * options_.max_thickness_m;
  if (eigen.l(2) <= thickness2 && eigen.l(2) <= options_.max_flatness * eigen.l(1) &&
      eigen.l(1) >= options_.min_breadth * eigen.l(0)) {
    s.kind = Surface::Kind::kPlane;
  }
  return s;
}

PointCluster VoxelMap::SumTree(NodeId id, std::vector<TreeSum>* sums) {
  const Node& n = node(id);
  const std::size_t slot = sums->size();
  sums->push_back({id, n.fixed, n.fixed_frames + n.window_frames});
  PointCluster sum = n.fixed;
  sum += n.window;
  int frames = n.fixed_frames + n.window_frames;
  for (const NodeId child : n.child) {
    if (child == kNoNode) continue;
    const std::size_t child_slot = sums->size();
    sum += SumTree(child, sums);
    // Frames of the children overlap in ways that are not counted; the largest is a sure lower
    // bound.
    frames = std::max(frames, (*sums)[child_slot].frames);
  }
  (*sums)[slot].cluster = sum;
  (*sums)[slot].frames = frames;
  return sum;
}

void VoxelMap::RefreshTree(NodeId root, std::vector<TreeSum>* sums) {
  sums->clear();
  SumTree(root, sums);
  for (const TreeSum& sum : *sums) {
    Node& n = node(sum.id);
    // Below a planar node no query looks: its eigenvalues are saved.
    const NodeId parent = n.parent;
    const bool covered = parent != kNoNode && node(parent).surface.covered;
    if (!covered) n.surface = SurfaceOf(sum.cluster, sum.frames);
    n.surface.covered = covered || n.surface.kind == Surface::Kind::kPlane;
  }
}

void VoxelMap::Refresh() {
  if (marked_.empty()) return;
  ++refreshes_;
  ParallelChunks(marked_.size(), 256, [this](std::size_t begin, std::size_t end) {
    std::vector<TreeSum> sums;
    for (std::size_t i = begin; i < end; ++i) {
      RefreshTree(marked_[i], &sums);
      node(marked_[i]).marked = false;
      node(marked_[i]).refreshed = static_cast<std::uint32_t>(refreshes_);
    }
  });
  for (std::size_t i = 0; track_tiles_ && i < marked_.size(); ++i) {
    TouchTile(TileOf(node(marked_[i]).key), refreshes_);
  }
  marked_.clear();
}

void VoxelMap::TouchTile(VoxelKey tile, std::int64_t change) {
  tiles_[SlotOf(tile)].Touch(PlaceOfTile(tile), change);
}

void VoxelMap::TrackTiles() {
  track_tiles_ = true;
  tiles_.clear();
  for (NodeId root = oldest_; root != kNoNode; root = node(root).newer) {
    TouchTile(TileOf(node(root).key), std::int64_t{node(root).refreshed});
  }
  if (store_ == nullptr) return;
  store_->ForEachTile([this](VoxelKey tile) { TouchTile(tile, 0); });
}

const TileIndex* VoxelMap::tiles(std::int64_t piece) const {
  static const TileIndex kNone;
  if (!track_tiles_) return nullptr;
  const auto found = tiles_.find(SlotOfPiece(piece));
  return found == tiles_.end() ? &kNone : &found->second;
}

VoxelKey VoxelMap::TileAt(const Eigen::Vector3i& place, std::int64_t piece) const {
  return TileAtPlace(place, SlotOfPiece(piece));
}

std::size_t VoxelMap::bytes() const {
  return blocks_.size() * (kBlockMask + 1) * sizeof(Node) + index_.bytes() +
         marked_.capacity() * sizeof(NodeId) + blocks_.capacity() * sizeof(blocks_[0]);
}

// What eviction goes by. Capacities that depend on the way there, and are not saved, must not
// count: a map that was saved and loaded has to evict the same roots as one that never was.
std::size_t VoxelMap::UsedBytes() const {
  return used_nodes_ * sizeof(Node) + index_.bytes() + roots() * sizeof(NodeId) +
         used_nodes_ / (kBlockMask + 1) * sizeof(blocks_[0]);
}

std::size_t VoxelMap::EvictToBudget() {
  // Blocks are never given back, they are filled again: so room must be made before the pool would
  // grow over the budget, with a reserve for what the next frame may add: a twentieth or, where a
  // scan is much of a small budget, a little more than the last one added.
  const double budget = options_.BudgetBytes();
  const double added =
      static_cast<double>(UsedBytes()) - static_cast<double>(bytes_after_eviction_);
  constexpr double kBlockBytes = (kBlockMask + 1) * sizeof(Node);  // the last one may be begun
  const double reserve = std::max(0.05 * budget, 1.25 * added) + kBlockBytes;
  const std::size_t dropped = EvictTo(budget - reserve, touches_);
  bytes_after_eviction_ = UsedBytes();
  std::rotate(recent_touches_.begin(), recent_touches_.begin() + 1, recent_touches_.end());
  recent_touches_.back() = touches_;
  return dropped;
}

std::size_t VoxelMap::EvictTo(double limit, std::uint64_t last_touch) {
  std::size_t dropped = 0;
  StateArchive record;
  NodeId root = oldest_;
  while (root != kNoNode && node(root).touched <= last_touch &&
         static_cast<double>(UsedBytes()) > limit) {
    const NodeId next = node(root).newer;
    const VoxelKey key = node(root).key;
    if (node(root).holds == 0 && !node(root).marked) {
      BeforeChange(root);
      if (store_ != nullptr) {
        record.written().clear();
        ArchiveRoot(record, root);
        store_->Put(TileOf(key), key, record.written());
      }
      RemoveRoot(root);
      ++dropped;
    }
    root = next;
  }
  return dropped;
}

std::int32_t VoxelMap::LastAdded(NodeId id) const {
  std::int32_t last = node(id).last_added;
  for (const NodeId child : node(id).child) {
    if (child != kNoNode) last = std::max(last, LastAdded(child));
  }
  return last;
}

void VoxelMap::VisitRoot(NodeId root, int min_frames, const VisitSurfel& visit) const {
  const auto slot = static_cast<std::size_t>(SlotOf(node(root).key));
  VisitSurfaces(root, min_frames, pieces_.at(slot), visit);
}

void VoxelMap::VisitSurfaces(NodeId id, int min_frames, std::int64_t piece,
                             const VisitSurfel& visit) const {
  const Node& n = node(id);
  if (n.surface.kind == Surface::Kind::kPlane) {
    // Below a planar node nothing is kept up to date: what it does not show, its children may not.
    if (n.surface.frames < min_frames) return;
    const PointCluster cluster = Aggregate(id);
    const Eigen3 eigen = cluster.Eigen();
    Surfel surfel;
    surfel.centre = cluster.mean;
    surfel.normal = eigen.u.col(2).cast<float>();
    surfel.eigenvalues = eigen.l.cwiseMax(0.0).cast<float>();
    surfel.count = static_cast<std::uint32_t>(std::lround(cluster.count));
    surfel.last_keyframe = LastAdded(id);
    surfel.piece = piece;
    visit(surfel);
    return;
  }
  for (const NodeId child : n.child) {
    if (child != kNoNode) VisitSurfaces(child, min_frames, piece, visit);
  }
}

}  // namespace lamina
