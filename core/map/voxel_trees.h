// The octrees of the map: their nodes, an index of the roots, and the order of their last touches.
//
// A tree is a root, inner nodes and leaves, all leaves at one depth; only nodes that hold anything
// exist. Each kind of node takes the memory of what it holds, and the parts that only some nodes
// have lie in pools of their own:
//
//     leaf 68 bytes    counters and the fixed cluster, packed (core/geometry/packed_cluster.h)
//     inner node 44    its children
//     root 80          that, its key, and what the order of touches and a snapshot need
//     plane 48         of a coarsest planar node
//     window 80        the sums of what frames of the window have in a leaf, at full precision
//
// A root voxel that is not divided (depth 0) has one leaf, as large as itself.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>

#include "core/geometry/cluster_moments.h"
#include "core/geometry/packed_cluster.h"
#include "core/geometry/state_archive.h"
#include "core/map/block_pool.h"
#include "core/map/root_key.h"
#include "core/map/surface.h"
#include "core/map/voxel_key.h"

namespace lamina {

template <>
inline constexpr bool kPlainState<PackedCluster> = true;
template <>
inline constexpr bool kPlainState<ClusterMoments> = true;
static_assert(sizeof(ClusterMoments) == 10 * sizeof(double));

// A kind in two bits and the number in its pool.
using NodeId = std::int32_t;
inline constexpr NodeId kNoNode = -1;

// Of counts of frames.
inline std::uint16_t SaturatingAdd(std::uint16_t a, int b) {
  constexpr int kMost = std::numeric_limits<std::uint16_t>::max();
  return static_cast<std::uint16_t>(std::min(kMost, static_cast<int>(a) + b));
}

struct MapNode {
  NodeId parent = kNoNode;
  std::int32_t plane = kNoNode;  // in the pool of planes
  std::uint16_t frames = 0;      // that contributed, saturating; as of the last refresh
  Surface::Kind kind = Surface::Kind::kEmpty;
};

struct MapLeaf : MapNode {
  std::int32_t window = kNoNode;  // in the pool of window clusters
  std::uint16_t fixed_frames = 0, window_frames = 0;
  std::int32_t last_added = -1, last_fixed = -1;  // frames, to count each once
  PackedCluster fixed;                            // relative to the root's centre
};
static_assert(sizeof(MapLeaf) == 68);

struct MapInner : MapNode {
  NodeId child[8] = {kNoNode, kNoNode, kNoNode, kNoNode, kNoNode, kNoNode, kNoNode, kNoNode};
};
static_assert(sizeof(MapInner) == 44);

struct MapRoot : MapInner {
  std::uint32_t holds : 31, marked : 1;
  VoxelKey key = 0;
  NodeId older = kNoNode, newer = kNoNode;  // list in order of touch
  std::uint64_t touched = 0;                // number of the touch: grows along the list
  std::uint32_t snapshot = 0;               // the last one that has it, or does not want it
  std::uint32_t refreshed = 0;              // by which refresh

  MapRoot() : holds(0), marked(0) {}
};
static_assert(sizeof(MapRoot) == 80);

// A leaf by the key of its root (in slot 0) and the child of each level, three bits each, that of
// the root on top. No root in range has the key 0.
struct LeafPlace {
  VoxelKey key = 0;
  std::uint32_t path = 0;

  bool operator==(const LeafPlace& o) const { return key == o.key && path == o.path; }
};

// Thread-safety: const members may run at once, and so may changes of nodes of different trees that
// make or free nothing; all else needs the object for itself.
class VoxelTrees {
 public:
  VoxelTrees(double root_size_m, int depth);

  // --- Nodes ---------------------------------------------------------------------------------

  static bool IsLeaf(NodeId id) { return id >> kKindShift == kLeafKind; }
  MapNode& node(NodeId id) { return const_cast<MapNode&>(std::as_const(*this).node(id)); }
  const MapNode& node(NodeId id) const {
    const NodeId i = id & kPlaceMask;
    if (id >> kKindShift == kLeafKind) return leaves_[i];
    if (id >> kKindShift == kRootKind) return roots_[i];
    return inner_[i];
  }
  MapLeaf& leaf(NodeId id) { return leaves_[id]; }
  const MapLeaf& leaf(NodeId id) const { return leaves_[id]; }
  const MapInner& inner(NodeId id) const { return inner_[id & kPlaceMask]; }
  MapRoot& root(NodeId id) { return roots_[id & kPlaceMask]; }
  const MapRoot& root(NodeId id) const { return roots_[id & kPlaceMask]; }
  // Of a root or an inner node: eight, kNoNode where there is none.
  const NodeId* children(NodeId id) const {
    return id >> kKindShift == kRootKind ? roots_[id & kPlaceMask].child
                                         : inner_[id & kPlaceMask].child;
  }
  NodeId RootOf(NodeId id) const {
    if (IsLeaf(id)) id = leaves_[id].parent;
    while (id >> kKindShift == kInnerKind) id = inner_[id & kPlaceMask].parent;
    return id;
  }
  // Centre of the root above a node; packed clusters are relative to it.
  Eigen::Vector3d CentreOf(NodeId id) const {
    return RootCentre(root(RootOf(id)).key, root_size_m_);
  }
  // The leaf around p, which must be in range.
  LeafPlace PlaceOf(const Eigen::Vector3d& p) const {
    LeafPlace place;
    for (int axis = 0; axis < 3; ++axis) {
      const double x = p[axis] * inverse_leaf_size_;
      auto leaf = static_cast<std::int64_t>(x);
      leaf -= static_cast<double>(leaf) > x ? 1 : 0;  // floor, without a call
      place.key |= static_cast<VoxelKey>((leaf >> depth_) + RootKeyLayout::kOffset[axis])
                   << RootKeyLayout::kShift[axis];
      place.path |= kSpread[leaf & most_leaf_] << axis;
    }
    return place;
  }
  // The leaves around the means of clusters, every `stride`-th one of them, that R and t move:
  // PlaceOf(R mean + t), or LeafPlace(), in which nothing is, for those out of range.
  void PlacesOf(const PointCluster* clusters, std::size_t stride, std::size_t count,
                const Eigen::Matrix3d& R, const Eigen::Vector3d& t, LeafPlace* places) const;
  // The child on the way to a leaf, `level` levels above it.
  static unsigned SlotOfPath(std::uint64_t path, int level) {
    return static_cast<unsigned>(path >> (3 * level)) & 7U;
  }
  // Levels below a root.
  int levels() const { return std::max(1, depth_); }

  // The plane of a node of kind kPlane.
  const Surface& plane(const MapNode& node) const { return planes_[node.plane]; }
  Surface& plane(const MapNode& node) { return planes_[node.plane]; }
  // Makes or frees a node's plane, as its kind wants it.
  void FitPlane(MapNode* node);

  // The window part of a leaf, about its root's centre; made if it is not there; null if there is
  // none.
  ClusterMoments& Window(MapLeaf* leaf) {
    if (leaf->window == kNoNode) leaf->window = windows_.New();
    return windows_[leaf->window];
  }
  const ClusterMoments* FindWindow(const MapLeaf& leaf) const {
    return leaf.window == kNoNode ? nullptr : &windows_[leaf.window];
  }
  // Frees the window part of a leaf if it is empty.
  void DropEmptyWindow(MapLeaf* leaf);

  // visit(const MapLeaf&) for all leaves below a node, or for that leaf itself.
  template <typename Visit>
  void ForEachLeaf(NodeId id, const Visit& visit) const {
    if (IsLeaf(id)) {
      visit(leaf(id));
      return;
    }
    const NodeId* child = children(id);
    for (int slot = 0; slot < 8; ++slot) {
      if (child[slot] != kNoNode) ForEachLeaf(child[slot], visit);
    }
  }

  // --- Trees ---------------------------------------------------------------------------------

  NodeId FindRoot(VoxelKey key) const { return index_.Find(key); }
  // Touched, and the newest. There must be none with this key.
  NodeId AddRoot(VoxelKey key);
  void RemoveRoot(NodeId root);
  // The child of a root or an inner node, made if it is not there.
  NodeId ChildAt(NodeId parent, unsigned slot);

  // Roots in the order of their last touch.
  NodeId oldest() const { return oldest_; }
  NodeId newer(NodeId root) const { return roots_[root & kPlaceMask].newer; }
  void Touch(NodeId root) {
    Unlink(root);
    Link(root);
    roots_[root & kPlaceMask].touched = ++touches_;
  }
  // Links a loaded root as the newest; its number of touch stays.
  void Link(NodeId root);

  // A tree as bytes (voxel_map_records.cc). Load makes a root that is in the index, not linked;
  // kNoNode if there is one with its key already.
  void Save(StateArchive& a, NodeId root) const;
  NodeId Load(StateArchive& a);

  // --- Memory --------------------------------------------------------------------------------

  std::size_t roots() const { return index_.size(); }
  std::size_t leaves() const { return leaves_.used(); }
  std::size_t nodes() const { return leaves_.used() + inner_.used() + roots_.used(); }
  // Memory taken.
  std::size_t bytes() const;
  // What is in use, by content alone: a map that was saved and loaded has the same figure as one
  // that never was.
  double used_bytes() const;
  // Whether so much may come in addition, in the present mix of nodes, without memory growing
  // beyond `most_bytes`.
  bool HasRoom(double more_bytes, double most_bytes) const;
  static constexpr double kBlocksBytes =
      256.0 * (sizeof(MapLeaf) + sizeof(MapInner) + sizeof(MapRoot) + sizeof(Surface) +
               sizeof(ClusterMoments));

  std::uint64_t touches() const { return touches_; }
  // What decides on later evictions beside the content of the trees.
  void ArchiveCounters(StateArchive& a);

 private:
  static constexpr int kKindShift = 29;
  static constexpr NodeId kLeafKind = 0, kInnerKind = 1, kRootKind = 2;
  static constexpr NodeId kPlaceMask = (1 << kKindShift) - 1;

  // Three bits apart.
  static constexpr std::uint32_t kSpread[16] = {00,    01,    010,   011,   0100,  0101,
                                                0110,  0111,  01000, 01001, 01010, 01011,
                                                01100, 01101, 01110, 01111};
  NodeId* children(NodeId id) {
    return id >> kKindShift == kRootKind ? roots_[id & kPlaceMask].child
                                         : inner_[id & kPlaceMask].child;
  }
  int LevelOf(NodeId id) const;
  void Unlink(NodeId root);
  void FreeTree(NodeId id);
  void SaveTree(StateArchive& a, NodeId id) const;
  void LoadTree(StateArchive& a, NodeId id, int level);
  // Calls visit(pool) for each of them.
  template <typename Visit>
  void ForEachPool(const Visit& visit) const {
    visit(leaves_), visit(inner_), visit(roots_), visit(planes_), visit(windows_);
  }

  double root_size_m_, inverse_leaf_size_;
  int depth_;
  std::int64_t most_leaf_;  // along an edge
  VoxelIndex index_;
  BlockPool<MapLeaf> leaves_;
  BlockPool<MapInner> inner_;
  BlockPool<MapRoot> roots_;
  BlockPool<Surface> planes_;
  BlockPool<ClusterMoments> windows_;
  NodeId oldest_ = kNoNode, newest_ = kNoNode;
  std::uint64_t touches_ = 0;
};

}  // namespace lamina
