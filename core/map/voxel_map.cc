#include "core/map/voxel_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "core/base/parallel.h"

namespace lamina {
namespace {

inline std::uint16_t SaturatingAdd(std::uint16_t a, int b) {
  constexpr int kMost = std::numeric_limits<std::uint16_t>::max();
  return static_cast<std::uint16_t>(std::min(kMost, static_cast<int>(a) + b));
}

// Whether l3 > most_l3 or l3 > most_flatness l2 for certain, from the coefficients of the
// characteristic polynomial alone: most nodes without a plane are spared the decomposition. With
//
//     I1 = l1 + l2 + l3    I2 = l1 l2 + l1 l3 + l2 l3    I3 = l1 l2 l3
//
// l3 >= I3 / I2, since I2 >= l1 l2; l2 <= I2 / l1 for the same reason, and l1 >= (I1^2 - 2 I2) / I1
// since the sum of the squares is at most l1 I1.
bool SurelyThick(const Symmetric3& s, double most_l3, double most_flatness) {
  // What is within rounding is decided by the decomposition.
  constexpr double kSure = 1.0 + 1e-9, kRounding = 1e-14;
  const double xy2 = s.xy * s.xy, xz2 = s.xz * s.xz, yz2 = s.yz * s.yz;
  const double i1 = s.Trace();
  const double i2 = s.xx * s.yy - xy2 + s.xx * s.zz - xz2 + s.yy * s.zz - yz2;
  const double i3 = s.xx * (s.yy * s.zz - yz2) - s.zz * xy2 - s.yy * xz2 + 2.0 * s.xy * s.xz * s.yz;
  if (!(i2 > 0.0)) return false;
  const double least_i3 = i3 - kRounding * i1 * i1 * i1;
  const double least_l1 = (i1 * i1 - 2.0 * i2) / i1;
  return least_i3 > kSure * most_l3 * i2 || least_i3 * least_l1 > kSure * most_flatness * i2 * i2;
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
  trees_.RemoveRoot(root);
}

VoxelMap::NodeId VoxelMap::FindSurface(const Eigen::Vector3d& p) const {
  const LeafPlace place = trees_.PlaceOf(p);
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
  PointCluster sum;
  const Eigen::Vector3d centre = trees_.CentreOf(id);
  trees_.ForEachLeaf(id, [&](const MapLeaf& leaf) {
    sum += leaf.fixed.Unpacked(centre);
    if (const PointCluster* window = trees_.FindWindow(leaf)) sum += *window;
  });
  return sum;
}

PointCluster VoxelMap::FixedAggregate(NodeId id) const {
  PointCluster sum;
  const Eigen::Vector3d centre = trees_.CentreOf(id);
  trees_.ForEachLeaf(id, [&](const MapLeaf& leaf) { sum += leaf.fixed.Unpacked(centre); });
  return sum;
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

void VoxelMap::Mark(NodeId root) {
  snapshot_.BeforeChange(root, &trees_);
  if (trees_.root(root).marked != 0) return;
  MarkLoaded(root);
}

void VoxelMap::MarkLoaded(NodeId root) {
  trees_.root(root).marked = 1;
  marked_.push_back(root);
}

void VoxelMap::AddWindow(NodeId leaf, const PointCluster& cluster, std::int64_t frame) {
  Mark(trees_.RootOf(leaf));
  MapLeaf& n = trees_.leaf(leaf);
  trees_.Window(&n) += cluster;
  if (n.last_added != frame) n.window_frames = SaturatingAdd(n.window_frames, 1);
  n.last_added = static_cast<std::int32_t>(frame);
}

void VoxelMap::ReplaceWindow(NodeId leaf, const PointCluster& before, const PointCluster& after) {
  Mark(trees_.RootOf(leaf));
  PointCluster& window = trees_.Window(&trees_.leaf(leaf));
  window -= before;
  window += after;
}

void VoxelMap::FixWindow(NodeId leaf, const PointCluster& cluster, double weight,
                         std::int64_t frame) {
  Mark(trees_.RootOf(leaf));
  MapLeaf& n = trees_.leaf(leaf);
  if (n.last_fixed != frame) {
    n.fixed_frames = SaturatingAdd(n.fixed_frames, 1);
    n.window_frames = static_cast<std::uint16_t>(n.window_frames - 1);
  }
  n.last_fixed = static_cast<std::int32_t>(frame);
  trees_.Window(&n) -= cluster;
  trees_.DropEmptyWindow(&n);
  JoinFixed(leaf, cluster.Scaled(weight));
}

void VoxelMap::AddFixed(NodeId leaf, const PointCluster& cluster, int frames,
                        std::int64_t last_frame) {
  Mark(trees_.RootOf(leaf));
  MapLeaf& n = trees_.leaf(leaf);
  n.last_added = std::max(n.last_added, static_cast<std::int32_t>(last_frame));
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

Surface VoxelMap::SurfaceOf(const PointCluster& cluster, int frames) const {
  Surface s;
  s.mean = cluster.mean;
  s.frames = SaturatingAdd(0, frames);
  if (cluster.count < options_.min_points) return s;
  s.kind = Surface::Kind::kRough;
  const double thickness2 = options_.max_thickness_m * options_.max_thickness_m;
  const Symmetric3 covariance = cluster.Covariance();
  if (SurelyThick(covariance, thickness2, options_.max_flatness)) return s;
  const Eigen3 eigen = EigenDecompose(covariance);
  constexpr double kLeastVariance = 1e-8;  // m^2, so that the breadth follows from the flatness
  s.variance = static_cast<float>(std::max(kLeastVariance, eigen.l(2)));
  if (eigen.l(1) > 0.0) s.flatness = s.variance / static_cast<float>(eigen.l(1));
  s.normal = eigen.u.col(2).cast<float>();
  if (eigen.l(2) <= thickness2 && eigen.l(2) <= options_.max_flatness * eigen.l(1) &&
      eigen.l(1) >= options_.min_breadth * eigen.l(0)) {
    s.kind = Surface::Kind::kPlane;
  }
  return s;
}

PointCluster VoxelMap::SumTree(NodeId id, const Eigen::Vector3d& centre,
                               std::vector<TreeSum>* sums) const {
  const std::size_t place = sums->size();
  sums->push_back({id, {}, 0, 0});
  PointCluster sum;
  int frames = 0;
  if (VoxelTrees::IsLeaf(id)) {
    const MapLeaf& leaf = trees_.leaf(id);
    sum = leaf.fixed.Unpacked(centre);
    if (const PointCluster* window = trees_.FindWindow(leaf)) sum += *window;
    frames = leaf.fixed_frames + leaf.window_frames;
  } else {
    const NodeId* child = trees_.children(id);
    for (int slot = 0; slot < 8; ++slot) {
      if (child[slot] == kNoNode) continue;
      const std::size_t of_child = sums->size();
      sum += SumTree(child[slot], centre, sums);
      // Frames of the children overlap in ways that are not counted; the largest is a sure lower
      // bound.
      frames = std::max(frames, (*sums)[of_child].frames);
    }
  }
  (*sums)[place].cluster = sum;
  (*sums)[place].frames = frames;
  (*sums)[place].end = sums->size();
  return sum;
}

void VoxelMap::RefreshTree(NodeId root, std::vector<TreeSum>* sums,
                           std::vector<PlaneChange>* changes) {
  sums->clear();
  SumTree(root, trees_.CentreOf(root), sums);
  // Below a planar node no query looks: its eigenvalues are saved. Children follow their parents,
  // so that being covered ends with the last node below the planar one.
  std::size_t covered_until = 0;
  for (std::size_t i = 0; i < sums->size(); ++i) {
    const TreeSum& sum = (*sums)[i];
    MapNode& n = trees_.node(sum.id);
    n.frames = SaturatingAdd(0, sum.frames);
    Surface surface;
    if (i >= covered_until) surface = SurfaceOf(sum.cluster, sum.frames);
    n.kind = surface.kind;
    if (n.kind == Surface::Kind::kPlane) covered_until = sum.end;
    if ((n.kind == Surface::Kind::kPlane) == (n.plane != kNoNode)) {
      if (n.plane != kNoNode) trees_.plane(n) = surface;
    } else {
      changes->push_back({sum.id, surface});
    }
  }
}

void VoxelMap::Refresh() {
  if (marked_.empty()) return;
  ++refreshes_;
  constexpr std::size_t kChunk = 256;
  std::vector<std::vector<PlaneChange>> changes((marked_.size() + kChunk - 1) / kChunk);
  ParallelChunks(marked_.size(), kChunk, [&](std::size_t begin, std::size_t end) {
    std::vector<TreeSum> sums;
    for (std::size_t i = begin; i < end; ++i) {
      RefreshTree(marked_[i], &sums, &changes[begin / kChunk]);
      trees_.root(marked_[i]).marked = 0;
      trees_.root(marked_[i]).refreshed = static_cast<std::uint32_t>(refreshes_);
    }
  });
  for (const std::vector<PlaneChange>& of_chunk : changes) {
    for (const PlaneChange& change : of_chunk) {
      MapNode& n = trees_.node(change.node);
      trees_.FitPlane(&n);
      if (n.plane != kNoNode) trees_.plane(n) = change.surface;
    }
  }
  for (std::size_t i = 0; track_tiles_ && i < marked_.size(); ++i) {
    TouchTile(TileOf(trees_.root(marked_[i]).key), refreshes_);
  }
  marked_.clear();
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
  if (VoxelTrees::IsLeaf(id)) return;
  const NodeId* child = trees_.children(id);
  for (int slot = 0; slot < 8; ++slot) {
    if (child[slot] != kNoNode) VisitSurfaces(child[slot], min_frames, piece, visit);
  }
}

}  // namespace lamina
