#include "core/map/voxel_map.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "core/map/window_lanes.h"

namespace lamina {

void VoxelMapOptions::Visit(OptionVisitor& v) {
  v.Number("root_size_m", &root_size_m, 0.05, 20.0);
  v.Integer("depth", &depth, 0, 4);
  v.Integer("min_points", &min_points, 4, 10000);
  v.Number("max_thickness_m", &max_thickness_m, 1e-4, 10.0);
  v.Number("max_flatness", &max_flatness, 1e-6, 1.0);
  v.Number("min_breadth", &min_breadth, 0.0, 1.0);
  v.Number("noise_floor_m", &noise_floor_m, 1e-4, 1.0);
  v.Number("max_cluster_weight", &max_cluster_weight, 1.0, 1e6);
  v.Number("max_fixed_weight", &max_fixed_weight, 1.0, 1e9);
  v.Number("budget_mb", &budget_mb, 1.0, kMostBudgetMb);
}

VoxelMap::VoxelMap(const VoxelMapOptions& options, VoxelStore* store)
    : options_(options),
      inverse_root_size_(1.0 / options.root_size_m),
      store_(store),
      trees_(options.root_size_m, options.depth) {
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

std::int64_t VoxelMap::LastPiece() const {
  return *std::max_element(pieces_.begin(), pieces_.end());
}

void VoxelMap::BeginPiece(std::int64_t piece) {
  const auto free = std::find(pieces_.begin(), pieces_.end(), kNoPiece);
  slot_ = static_cast<int>(free - pieces_.begin());
  if (free == pieces_.end()) pieces_.push_back(kNoPiece);
  pieces_[static_cast<std::size_t>(slot_)] = piece;
}

void VoxelMap::DropPiece(std::int64_t piece, const std::vector<VoxelKey>& roots) {
  for (const VoxelKey key : roots) {
    const NodeId root = trees_.FindRoot(key);
    if (root == kNoNode) continue;
    snapshot_.BeforeChange(root, &trees_);
    RemoveRoot(root);
  }
  pieces_[static_cast<std::size_t>(SlotOfPiece(piece))] = kNoPiece;
}

void VoxelMap::RemoveRoot(NodeId root) {
  snapshot_.BeforeMove(root, trees_);
  // Rarely: what is removed has been refreshed since it changed.
  if (trees_.root(root).marked != 0)
    marked_.erase(std::remove(marked_.begin(), marked_.end(), root), marked_.end());
  trees_.RemoveRoot(root);
}

VoxelMap::NodeId VoxelMap::FindSurface(const Eigen::Vector3d& p) const {
  return CanHold(p) ? FindSurface(trees_.PlaceOf(p)) : kNoNode;
}

const Surface* VoxelMap::PlaneAt(const Eigen::Vector3d& p) const {
  return CanHold(p) ? PlaneAt(trees_.PlaceOf(p)) : nullptr;
}

const Surface* VoxelMap::PlaneAt(const LeafPlace& place) const {
  const NodeId id = FindSurface(place);
  return id != kNoNode && kind(id) == Surface::Kind::kPlane ? &plane(id) : nullptr;
}

VoxelMap::NodeId VoxelMap::FindSurface(const LeafPlace& place) const {
  NodeId id = trees_.FindRoot(SlotBase(slot_) + place.key);
  if (id == kNoNode || trees_.root(id).kind == Surface::Kind::kPlane) return id;
  const NodeId* child = trees_.root(id).child;
  for (int level = trees_.levels() - 1;; --level) {
    id = child[VoxelTrees::SlotOfPath(place.path, level)];
    if (level == 0 || id == kNoNode) return id;
    const MapInner& inner = trees_.inner(id);
    if (inner.kind == Surface::Kind::kPlane) return id;
    child = inner.child;
  }
}

VoxelMap::NodeId VoxelMap::PlaneAbove(NodeId leaf) const {
  NodeId best = kNoNode;
  for (NodeId id = leaf; id != kNoNode; id = trees_.node(id).parent) {
    if (trees_.node(id).kind == Surface::Kind::kPlane) best = id;
  }
  return best;
}

PointCluster VoxelMap::Aggregate(NodeId id) const {
  ClusterMoments sum;
  trees_.ForEachLeaf(id, [&](const MapLeaf& leaf) {
    sum += leaf.fixed.Moments();
    if (const ClusterMoments* window = trees_.FindWindow(leaf)) sum += *window;
  });
  return sum.Cluster(trees_.CentreOf(id));
}

PointCluster VoxelMap::FixedAggregate(NodeId id) const {
  ClusterMoments sum;
  trees_.ForEachLeaf(id, [&](const MapLeaf& leaf) { sum += leaf.fixed.Moments(); });
  return sum.Cluster(trees_.CentreOf(id));
}

VoxelMap::NodeId VoxelMap::LeafAt(const Eigen::Vector3d& p, LeafAddress* address) {
  const LeafPlace place = trees_.PlaceOf(p);
  const VoxelKey key = SlotBase(slot_) + place.key;
  NodeId id = trees_.FindRoot(key);
  if (id == kNoNode && store_ != nullptr && store_->Has(TileOf(key))) {
    store_->TakeRoot(TileOf(key), key, [this](std::string_view record) { Return(record); });
    id = trees_.FindRoot(key);
  }
  if (id == kNoNode) {
    id = trees_.AddRoot(key);
    trees_.root(id).snapshot = snapshot_.number();
  } else {
    snapshot_.BeforeChange(id, &trees_);
    snapshot_.BeforeMove(id, trees_);
    trees_.Touch(id);
  }
  for (int level = trees_.levels() - 1; level >= 0; --level) {
    id = trees_.ChildAt(id, VoxelTrees::SlotOfPath(place.path, level));
  }
  if (address != nullptr) *address = {key, place.path};
  return id;
}

void VoxelMap::MarkLoaded(NodeId root) {
  trees_.root(root).marked = 1;
  marked_.push_back(root);
}

void VoxelMap::AddWindow(NodeId leaf, const PointCluster& cluster, std::int64_t frame) {
  const NodeId root = CountInWindow(leaf, frame);
  trees_.Window(&trees_.leaf(leaf)) += ClusterMoments::Of(cluster, trees_.CentreOf(root));
}

VoxelMap::NodeId VoxelMap::CountInWindow(NodeId leaf, std::int64_t frame) {
  const NodeId root = trees_.RootOf(leaf);
  Mark(root);
  MapLeaf& n = trees_.leaf(leaf);
  if (n.last_added != frame) n.window_frames = SaturatingAdd(n.window_frames, 1);
  n.last_added = static_cast<std::int32_t>(frame);
  return root;
}

std::vector<VoxelMap::NodeId> VoxelMap::AddFrame(const std::vector<PointCluster>& clusters,
                                                 std::int64_t frame,
                                                 std::vector<LeafAddress>* held) {
  const std::size_t n = clusters.size();
  std::vector<NodeId> leaves(n, kNoNode);
  FourWindows four(options_.root_size_m);
  for (std::size_t i = 0; i < n + kLeavesAhead; ++i) {
    if (i < n && CanHold(clusters[i].mean)) {
      leaves[i] = LeafAt(clusters[i].mean, held == nullptr ? nullptr : &(*held)[i]);
      Prefetch(leaves[i]);
    }
    if (i >= kLeavesAhead / 2 && i < n + kLeavesAhead / 2) {
      PrefetchAround(leaves[i - kLeavesAhead / 2]);
    }
    if (i < kLeavesAhead || leaves[i - kLeavesAhead] == kNoNode) continue;
    const NodeId leaf = leaves[i - kLeavesAhead];
    if (held != nullptr) Hold(leaf);
    const VoxelKey root = trees_.root(CountInWindow(leaf, frame)).key;
    four.Take(root, clusters[i - kLeavesAhead], &trees_.Window(&trees_.leaf(leaf)));
    if (four.full()) four.Add();
  }
  four.Add();
  return leaves;
}

void VoxelMap::AddFrame(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar,
                        std::int64_t frame) {
  const Eigen::Matrix3d R = T_world_lidar.R();
  std::vector<PointCluster> moved;
  moved.reserve(clusters.size());
  for (const PointCluster& cluster : clusters) moved.push_back(cluster.Moved(R, T_world_lidar.t));
  AddFrame(moved, frame);
}

void VoxelMap::ReplaceWindow(const std::vector<NodeId>& leaves,
                             const std::vector<PointCluster>& before,
                             const std::vector<PointCluster>& after) {
  FourWindows four(options_.root_size_m);
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    if (i + 2 * kLeavesAhead < leaves.size()) Prefetch(leaves[i + 2 * kLeavesAhead]);
    if (i + kLeavesAhead < leaves.size()) PrefetchAround(leaves[i + kLeavesAhead]);
    if (leaves[i] == kNoNode) continue;
    const NodeId root = trees_.RootOf(leaves[i]);
    Mark(root);
    four.Take(trees_.root(root).key, before[i], &trees_.Window(&trees_.leaf(leaves[i])), &after[i]);
    if (four.full()) four.Exchange();
  }
  four.Exchange();
}

void VoxelMap::FixWindow(NodeId leaf, const PointCluster& cluster, double weight,
                         std::int64_t frame) {
  const NodeId root = trees_.RootOf(leaf);
  Mark(root);
  MapLeaf& n = trees_.leaf(leaf);
  if (n.last_fixed != frame) {
    n.fixed_frames = SaturatingAdd(n.fixed_frames, 1);
    n.window_frames = static_cast<std::uint16_t>(n.window_frames - 1);
  }
  n.last_fixed = static_cast<std::int32_t>(frame);
  trees_.Window(&n) -= ClusterMoments::Of(cluster, trees_.CentreOf(root));
  trees_.DropEmptyWindow(&n);
  JoinFixed(leaf, cluster.Scaled(weight));
}

void VoxelMap::AddFixed(NodeId leaf, const PointCluster& cluster, int frames,
                        std::int64_t last_frame) {
  Mark(trees_.RootOf(leaf));
  MapLeaf& n = trees_.leaf(leaf);
  n.last_added = std::max(n.last_added, static_cast<std::int32_t>(last_frame));
  n.last_fixed = std::max(n.last_fixed, static_cast<std::int32_t>(last_frame));
  n.fixed_frames = SaturatingAdd(n.fixed_frames, frames);
  JoinFixed(leaf, cluster);
}

void VoxelMap::JoinFixed(NodeId leaf, const PointCluster& cluster) {
  const Eigen::Vector3d centre = trees_.CentreOf(leaf);
  MapLeaf& n = trees_.leaf(leaf);
  PointCluster fixed = n.fixed.Unpacked(centre);
  fixed += cluster;
  n.fixed = PackedCluster::Of(fixed.Capped(options_.max_fixed_weight), centre);
}

void VoxelMap::Hold(NodeId leaf) {
  MapRoot& root = trees_.root(trees_.RootOf(leaf));
  root.holds = (root.holds + 1) & 0x7fffffffU;
}

void VoxelMap::Release(NodeId leaf) {
  MapRoot& root = trees_.root(trees_.RootOf(leaf));
  root.holds = (root.holds - 1) & 0x7fffffffU;
}

void VoxelMap::TouchTile(VoxelKey tile, std::int64_t change) {
  tiles_[SlotOf(tile)].Touch(PlaceOfTile(tile), change);
}

void VoxelMap::TrackTiles() {
  track_tiles_ = true;
  tiles_.clear();
  for (NodeId root = trees_.oldest(); root != kNoNode; root = trees_.newer(root)) {
    TouchTile(TileOf(trees_.root(root).key), std::int64_t{trees_.root(root).refreshed});
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

std::int32_t VoxelMap::LastAdded(NodeId id) const {
  std::int32_t last = -1;
  trees_.ForEachLeaf(id, [&](const MapLeaf& leaf) { last = std::max(last, leaf.last_added); });
  return last;
}

double VoxelMap::FixedSince(NodeId id, std::int64_t frame, double points_per_frame) const {
  double points = 0.0;
  trees_.ForEachLeaf(id, [&](const MapLeaf& leaf) {
    if (leaf.last_fixed < frame) return;
    const auto since = static_cast<double>(leaf.last_fixed - frame + 1);
    points += std::min(static_cast<double>(leaf.fixed.count), since * points_per_frame);
  });
  return points;
}

void VoxelMap::VisitRoot(NodeId root, int min_frames, const VisitSurfel& visit) const {
  const auto slot = static_cast<std::size_t>(SlotOf(trees_.root(root).key));
  VisitSurfaces(root, min_frames, pieces_.at(slot), visit);
}

void VoxelMap::VisitSurfaces(NodeId id, int min_frames, std::int64_t piece,
                             const VisitSurfel& visit) const {
  const MapNode& n = trees_.node(id);
  if (n.kind == Surface::Kind::kPlane) {
    // Below a planar node nothing is kept up to date: what it does not show, its children may not.
    if (n.frames < min_frames) return;
    const PointCluster cluster = Aggregate(id);
    const Eigen3 eigen = cluster.EigenPairs();
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
  if (VoxelTrees::IsLeaf(id)) return;
  const NodeId* child = trees_.children(id);
  for (int slot = 0; slot < 8; ++slot) {
    if (child[slot] != kNoNode) VisitSurfaces(child[slot], min_frames, piece, visit);
  }
}

}  // namespace lamina
