// The map: a hash of root voxels, each the root of a small octree of point clusters.
//
// Clusters live in the leaves alone. Since clusters add, a parent is the sum of its eight children,
// and no level keeps a point. A *surface* is what matching and bundle adjustment look for: the
// COARSEST node around a place whose aggregate is planar (large flat walls are one feature, small
// patches of a rough facade are many).
//
// A leaf holds two clusters, in world coordinates:
//   fixed    of frames that have left the sliding window: capped weight, never moved again
//   window   the sum of the frames in the window at their present poses; the window exchanges them
//            when it moves the frames
//
// Every change marks the root; Refresh() brings the surfaces of the marked roots up to date, in
// parallel. Nothing here visits the whole map but ForEachSurface.
//
// Memory stays below `budget_mb`: the roots form a list in the order in which they were last
// touched, and EvictToBudget drops the longest untouched, unless the window still stands on them.
// A budget below what the window stands on cannot be kept; over_budget() says so.
//
// Thread-safety: const members may run at once; anything else needs the map for itself.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "core/options.h"
#include "core/point_cluster.h"
#include "core/surfel.h"
#include "core/voxel_key.h"

namespace lamina {

struct VoxelMapOptions {
  // Edge of a root voxel, and how often it is halved: leaf = root_size_m / 2^depth.
  double root_size_m = 1.6;
  int depth = 1;
  // A node is planar if it holds at least so many points, ...
  int min_points = 8;
  // ... sqrt(l3) is at most so thick, ...
  double max_thickness_m = 0.10;
  // ... l3 <= max_flatness * l2 (thin) and l2 >= min_breadth * l1 (not a line).
  double max_flatness = 0.1;
  double min_breadth = 0.02;
  // Points that a fixed cluster weighs at most: later data can still correct an old surface.
  double max_fixed_weight = 30.0;
  // Memory of the map, in units of 2^20 bytes.
  double budget_mb = 2048.0;

  void Visit(OptionVisitor& v);
  double LeafSize() const { return root_size_m / static_cast<double>(1 << depth); }
  double BudgetBytes() const { return budget_mb * 1048576.0; }
};

// What a node looks like from outside.
struct Surface {
  enum class Kind : std::uint8_t {
    kEmpty,  // too few points to say anything
    kRough,  // a distribution without a plane
    kPlane,
  };
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();  // unit, kPlane only; the sign has no meaning
  float variance = 0.0F;                             // l3, m^2: the plane's squared thickness
  float weight = 0.0F;                               // points, after capping
  std::uint16_t frames = 0;                          // frames that contributed, saturating
  Kind kind = Kind::kEmpty;
  bool covered =
      false;  // this node or one above it is planar; below that one, nothing is kept up to date
};

class VoxelMap {
 public:
  using NodeId = std::int32_t;
  static constexpr NodeId kNoNode = -1;

  // Throws OptionError.
  explicit VoxelMap(const VoxelMapOptions& options);

  const VoxelMapOptions& options() const { return options_; }

  // --- Reading -------------------------------------------------------------------------------

  // The coarsest planar node around p or, if there is none, the leaf around p (rough or empty);
  // kNoNode where the map has nothing.
  NodeId FindSurface(const Eigen::Vector3d& p) const;
  // The coarsest planar node among a leaf and its ancestors, else kNoNode.
  NodeId PlaneAbove(NodeId leaf) const;
  const Surface& surface(NodeId id) const { return node(id).surface; }
  // Sum of fixed and window clusters below a node / of the fixed ones alone.
  PointCluster Aggregate(NodeId id) const;
  PointCluster FixedAggregate(NodeId id) const;

  // Calls visit for every coarsest planar node with at least min_frames frames, from the longest to
  // the last touched root (the same order for the same input).
  void ForEachSurface(int min_frames, const std::function<void(const Surfel&)>& visit) const;

  std::size_t roots() const { return index_.size(); }
  std::size_t nodes() const { return used_nodes_; }
  std::size_t bytes() const;
  // After EvictToBudget: what is held alone takes, or once took, more than the budget.
  bool over_budget() const { return static_cast<double>(bytes()) > options_.BudgetBytes(); }

  // --- Writing -------------------------------------------------------------------------------

  // The leaf around p, made if it is not there; p must satisfy CanHold. Touches the root.
  NodeId LeafAt(const Eigen::Vector3d& p);
  bool CanHold(const Eigen::Vector3d& p) const { return IsVoxelKeyInRange(p, inverse_root_size_); }

  // The window part of a leaf. Clusters are in the world frame and belong to the frame `frame`; all
  // clusters of one frame are added before any of the next.
  void AddWindow(NodeId leaf, const PointCluster& cluster, std::int64_t frame);
  // Exchanges a cluster that was added before, when its frame has moved.
  void ReplaceWindow(NodeId leaf, const PointCluster& before, const PointCluster& after);
  // Marginalisation: a cluster that was added to the window part leaves it and joins the fixed
  // part, whose weight is then capped. Frames leave in the order in which they came.
  void FixWindow(NodeId leaf, const PointCluster& cluster, std::int64_t frame);

  // While a leaf is held, its root is not evicted. Calls add up.
  void Hold(NodeId leaf);
  void Release(NodeId leaf);

  // Brings surfaces of all marked roots up to date.
  void Refresh();

  // Drops the longest untouched roots until bytes() fits the budget; before a root goes, its
  // surfaces seen by at least min_frames frames are handed to `on_evict`. Returns the number
  // dropped. Roots that are held stay, even over budget. To be called after each frame.
  std::size_t EvictToBudget(int min_frames, const std::function<void(const Surfel&)>& on_evict);

 private:
  struct Node {
    PointCluster fixed, window;  // leaves alone
    Surface surface;
    NodeId child[8];  // kNoNode where empty; leaves have none
    NodeId parent = kNoNode;

    std::uint16_t fixed_frames = 0, window_frames = 0;
    std::int64_t last_added = -1, last_fixed = -1;  // frames, to count each once
    // Roots alone:
    VoxelKey key = 0;
    NodeId older = kNoNode, newer = kNoNode;  // list in order of touch
    std::uint32_t holds = 0;
    bool marked = false;
  };
  // Nodes live in blocks: big enough that their table stays small, small enough that a budget of a
  // megabyte is some dozen of them.
  static constexpr int kBlockBits = 8;
  static constexpr NodeId kBlockMask = (1 << kBlockBits) - 1;

  Node& node(NodeId id) {
    return blocks_[static_cast<std::size_t>(id >> kBlockBits)][id & kBlockMask];
  }
  const Node& node(NodeId id) const {
    return blocks_[static_cast<std::size_t>(id >> kBlockBits)][id & kBlockMask];
  }
  NodeId NewNode(NodeId parent);
  void FreeTree(NodeId id);
  NodeId RootOf(NodeId id) const;
  void Unlink(NodeId root);
  void LinkNewest(NodeId root);
  void Mark(NodeId leaf);
  struct TreeSum {
    NodeId id;
    PointCluster cluster;
    int frames;
  };
  // Sums of a node and all below it, parents before children; returns the node's own.
  PointCluster SumTree(NodeId id, std::vector<TreeSum>* sums);
  void RefreshTree(NodeId root, std::vector<TreeSum>* sums);
  Surface MakeSurface(const PointCluster& cluster, int frames) const;
  void VisitSurfaces(NodeId id, int min_frames,
                     const std::function<void(const Surfel&)>& visit) const;
  // Of nodes in use, and of all but nodes.
  std::size_t UsedBytes() const;
  std::size_t BookkeepingBytes() const;

  VoxelMapOptions options_;
  double inverse_root_size_;
  VoxelIndex index_;
  std::vector<std::unique_ptr<Node[]>> blocks_;
  NodeId next_unused_ = 0;
  NodeId free_list_ = kNoNode;  // chained through Node::parent
  std::size_t used_nodes_ = 0;
  std::size_t bytes_after_eviction_ = 0;
  NodeId oldest_ = kNoNode, newest_ = kNoNode;
  std::vector<NodeId> marked_;
};

}  // namespace lamina
