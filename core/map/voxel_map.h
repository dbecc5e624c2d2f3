// The map: a hash of root voxels, each the root of a small octree of point clusters.
//
// Clusters live in the leaves alone. Since clusters add, a parent is the sum of its eight children,
// and no level keeps a point. A *surface* is what matching and bundle adjustment look for: the
// COARSEST node around a place whose aggregate is planar (large flat walls are one feature, small
// patches of a rough facade are many).
//
// A leaf holds up to two clusters, in world coordinates:
//   fixed    of frames that have left the sliding window: capped weight, never moved again; packed
//            (core/geometry/packed_cluster.h)
//   window   the sum of the frames in the window at their present poses, about the root's centre
//            (core/geometry/cluster_moments.h); the window exchanges them when it moves the frames
// The trees and their memory are core/map/voxel_trees.h.
//
// Every change marks the root; Refresh() brings the surfaces of the marked roots up to date, in
// parallel. Nothing here visits the whole map but ForEachSurface.
//
// Memory stays below `budget_mb`: the roots form a list in the order in which they were last
// touched, and EvictToBudget moves the longest untouched to the VoxelStore, unless the window still
// stands on them. They come back when something new is to be put beside them, or by Recall(). A
// budget below what the window stands on cannot be kept; over_budget() says so.
//
// Pieces: parts of the map that no match connects (two recordings; what came before and after the
// sensor was lost). Each has a frame of its own, the *world* of all that is said here, and none
// sees the others, wherever their coordinates lie; index, budget, list and store are shared. What
// is read and written by coordinates is of the piece selected; nodes know theirs.
//
// Snapshot: the map as it stood at one moment, saved piece by piece while it goes on changing. A
// root is saved before its first change after that moment, or when its turn comes.
//
// Thread-safety: const members may run at once; anything else needs the map for itself.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/state_archive.h"
#include "core/map/map_snapshot.h"
#include "core/map/root_key.h"
#include "core/map/surface.h"
#include "core/map/surfel.h"
#include "core/map/tile_index.h"
#include "core/map/voxel_key.h"
#include "core/map/voxel_store.h"
#include "core/map/voxel_trees.h"
#include "core/options/options.h"

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
  // Standard deviation that no plane is believed to be better than: the sensor's range noise.
  double noise_floor_m = 0.02;
  // Points that a cluster of a scan weighs at most, in matching, in bundle adjustment and in the
  // map: dense surfaces nearby must not outvote the far ones.
  double max_cluster_weight = 4.0;
  // Points that a fixed cluster weighs at most: later data can still correct an old surface.
  double max_fixed_weight = 30.0;
  // Memory of the map, in units of 2^20 bytes.
  double budget_mb = 2048.0;
  // More leaves would be more than NodeId can number.
  static constexpr double kMostBudgetMb = 32e3;

  void Visit(OptionVisitor& v);
  double LeafSize() const { return root_size_m / static_cast<double>(1 << depth); }
  double BudgetBytes() const { return budget_mb * 1048576.0; }
};

class VoxelMap {
 public:
  using NodeId = lamina::NodeId;
  static constexpr NodeId kNoNode = lamina::kNoNode;

  // `store` gets what leaves memory, and must outlive the map; without one it is lost. Throws
  // OptionError.
  explicit VoxelMap(const VoxelMapOptions& options, VoxelStore* store = nullptr);

  const VoxelMapOptions& options() const { return options_; }

  // --- Pieces --------------------------------------------------------------------------------

  // Piece 0 is there from the beginning, and selected.
  void SelectPiece(std::int64_t piece);
  std::int64_t selected_piece() const { return pieces_[static_cast<std::size_t>(slot_)]; }
  bool HasPiece(std::int64_t piece) const;
  bool RoomForPiece() const;
  // The largest number of a piece.
  std::int64_t LastPiece() const;
  // A new one, numbered so, and selects it. There must be room.
  void BeginPiece(std::int64_t piece);
  // Of a piece that nothing is to be kept of: takes out these roots, which are not held, and are
  // all that it has; gives its room to another.
  void DropPiece(std::int64_t piece, const std::vector<VoxelKey>& roots);
  // The same of a piece of which nothing is held, in memory and in the store. A walk over all of
  // the map.
  void ErasePiece(std::int64_t piece);

  // --- Reading -------------------------------------------------------------------------------

  // The coarsest planar node around p or, if there is none, the leaf around p (rough or empty);
  // kNoNode where the map has nothing, or CanHold() nothing.
  NodeId FindSurface(const Eigen::Vector3d& p) const;
  // The plane around p; null if there is none.
  const Surface* PlaneAt(const Eigen::Vector3d& p) const;
  const Surface* PlaneAt(const LeafPlace& place) const;
  // The surface by the leaf voxel around a p that satisfies CanHold, on which alone it depends.
  LeafPlace PlaceOf(const Eigen::Vector3d& p) const { return trees_.PlaceOf(p); }
  NodeId FindSurface(const LeafPlace& place) const;
  // The leaf voxels around the means of clusters, every `stride`-th one of them, that R and t move:
  // PlaceOf(R mean + t), or LeafPlace(), where there is no surface, for those that CanHold refuses.
  void PlacesOf(const PointCluster* clusters, std::size_t stride, std::size_t count,
                const Eigen::Matrix3d& R, const Eigen::Vector3d& t, LeafPlace* places) const {
    trees_.PlacesOf(clusters, stride, count, R, t, places);
  }
  // The coarsest planar node among a leaf and its ancestors, else kNoNode.
  NodeId PlaneAbove(NodeId leaf) const;
  // As of the last refresh; below a planar node nothing is kept up to date.
  Surface::Kind kind(NodeId id) const { return trees_.node(id).kind; }
  // Frames that contributed, saturating.
  int frames(NodeId id) const { return trees_.node(id).frames; }
  // How many points of its fixed part are of this frame and later ones, at most, where a frame adds
  // so many to a leaf: each of these is taken to be in every leaf that has a later one.
  double FixedSince(NodeId id, std::int64_t frame, double points_per_frame) const;
  // Of a node of kind kPlane.
  const Surface& plane(NodeId id) const { return trees_.plane(trees_.node(id)); }
  // What a node with this cluster would look like.
  Surface SurfaceOf(const PointCluster& cluster, int frames) const;
  // Sum of fixed and window clusters below a node / of the fixed ones alone.
  PointCluster Aggregate(NodeId id) const;
  PointCluster FixedAggregate(NodeId id) const;

  // Calls visit for every coarsest planar node with at least min_frames frames: first those in
  // memory, from the longest to the last touched root, then those in the store (the same order for
  // the same input).
  using VisitSurfel = std::function<void(const Surfel&)>;
  void ForEachSurface(int min_frames, const VisitSurfel& visit) const;
  // The tile around p, which must satisfy CanHold, of a piece.
  VoxelKey TileAround(const Eigen::Vector3d& p, std::int64_t piece = 0) const {
    return TileOf(SlotBase(SlotOfPiece(piece)) + RootKeyOf(p, inverse_root_size_));
  }
  // Those of one tile. Returns the number of the refresh that last changed it; visits nothing if
  // that is `changed_by` or earlier (0 for what lies in the store).
  std::int64_t ForEachSurfaceOfTile(VoxelKey tile, std::int64_t changed_by, int min_frames,
                                    const VisitSurfel& visit) const;
  // The clusters of the leaves of one tile, in world coordinates, with the number of frames that
  // they are of; first those in memory, then those in the store, where they stay.
  using VisitLeaf = std::function<void(const PointCluster& cluster, int frames)>;
  void ForEachLeafOfTile(VoxelKey tile, const VisitLeaf& visit) const;
  // The tiles of a piece in memory and in the store, their changes numbered by refreshes(). Null
  // unless TrackTiles() was called.
  const TileIndex* tiles(std::int64_t piece = 0) const;
  double TileSize() const { return options_.root_size_m * (1 << kTileBits); }
  // The key of a tile by its indices, which are those of the lower corner in tiles.
  VoxelKey TileAt(const Eigen::Vector3i& place, std::int64_t piece = 0) const;
  // Whether the store has a part of a tile, so that showing it waits for the disk.
  bool IsStored(VoxelKey tile) const { return store_ != nullptr && store_->Has(tile); }

  // Has the processor fetch a node that is soon to be read or written. Code that walks many
  // leaves in an order of its own waits for memory more than for anything else.
  void Prefetch(NodeId id) const {
    if (id == kNoNode) return;
    FetchBytes(&trees_.node(id), sizeof(MapLeaf));
  }
  // The same of what belongs to a leaf that is there already: its root and its window part.
  void PrefetchAround(NodeId leaf) const {
    if (leaf == kNoNode) return;
    FetchBytes(&trees_.node(trees_.leaf(leaf).parent), sizeof(MapRoot));
    const ClusterMoments* const window = trees_.FindWindow(trees_.leaf(leaf));
    if (window != nullptr) FetchBytes(window, sizeof(*window));
  }
  // A loop that does little else does well to fetch so many leaves ahead.
  static constexpr std::size_t kLeavesAhead = 8;

  // Number of refreshes that changed anything.
  std::int64_t refreshes() const { return refreshes_; }

  std::size_t roots() const { return trees_.roots(); }
  std::size_t leaves() const { return trees_.leaves(); }
  std::size_t nodes() const { return trees_.nodes(); }
  std::size_t bytes() const;
  // After EvictToBudget: what is held alone takes, or once took, more than the budget.
  bool over_budget() const { return static_cast<double>(bytes()) > options_.BudgetBytes(); }

  // --- Writing -------------------------------------------------------------------------------

  // A leaf, named so that another map of the same content finds it.
  struct LeafAddress {
    VoxelKey root = 0;
    std::uint64_t path = 0;  // the child of each level, three bits each, that of the root on top
  };
  // The leaf around p, made if it is not there; p must satisfy CanHold. Touches the root. Its
  // address goes to *address.
  NodeId LeafAt(const Eigen::Vector3d& p, LeafAddress* address = nullptr);
  bool CanHold(const Eigen::Vector3d& p) const { return IsRootKeyInRange(p, inverse_root_size_); }

  // The window part of a leaf. Clusters are in the world frame and belong to the frame `frame`; all
  // clusters of one frame are added before any of the next.
  void AddWindow(NodeId leaf, const PointCluster& cluster, std::int64_t frame);
  // The same for all clusters of a frame, in their order. Returns the leaf of each, kNoNode where
  // the map cannot hold it. Unless null, `held`, of the same size, gets the addresses of these
  // leaves, which are held then.
  std::vector<NodeId> AddFrame(const std::vector<PointCluster>& clusters, std::int64_t frame,
                               std::vector<LeafAddress>* held = nullptr);
  // The same of clusters in the LiDAR frame.
  void AddFrame(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar,
                std::int64_t frame);
  // Exchanges the clusters that a frame added before, one to a leaf, when it has moved; their
  // counts stay. Those without a leaf, kNoNode, are passed over.
  void ReplaceWindow(const std::vector<NodeId>& leaves, const std::vector<PointCluster>& before,
                     const std::vector<PointCluster>& after);
  // Marginalisation: a cluster that was added to the window part leaves it and joins the fixed
  // part, its points weighing `weight` (0 to 1) times what they did; the weight of the fixed part
  // is then capped. Frames leave in the order in which they came.
  void FixWindow(NodeId leaf, const PointCluster& cluster, double weight, std::int64_t frame);

  // Adds to the fixed part of a leaf what `frames` frames, the last of them `last_frame`, have
  // gathered elsewhere, and caps its weight.
  void AddFixed(NodeId leaf, const PointCluster& cluster, int frames, std::int64_t last_frame);

  // The fixed part of a leaf as it was put together elsewhere, in world coordinates.
  struct FixedPart {
    PointCluster cluster;
    std::int32_t frames = 0, last_frame = -1;
  };
  // The fixed part of the selected piece, in memory and in the store, becomes these and nothing
  // else; the window's part stays. Each joins the leaf around its mean, in this order, so that the
  // last are touched last; those that CanHold() refuses are left out. Memory keeps the budget as by
  // EvictToBudget(). Between two frames, after Refresh(); refreshes. (voxel_map_assembly.cc)
  void ReplaceFixed(const std::vector<FixedPart>& parts);

  // While a leaf is held, its root is not evicted. Calls add up.
  void Hold(NodeId leaf);
  void Release(NodeId leaf);

  // Brings surfaces of all marked roots up to date.
  void Refresh();

  // From now on there is an index of the tiles: a look-up for each root that a refresh changes.
  void TrackTiles();

  // Moves the longest untouched roots to the store until bytes() fits the budget. Roots that are
  // held stay, even over budget. To be called after each frame. Returns the number moved.
  std::size_t EvictToBudget();

  // Brings back, and up to date, what the store has of the tiles around these points, as far as
  // there is room or can be made by evicting what no recent frame has touched: a budget below what
  // the sensor sees must not make every frame write and read it all. Returns the number of roots
  // that came.
  std::size_t Recall(const std::vector<Eigen::Vector3d>& points);

  // --- Saving and loading (voxel_map_records.cc) ---------------------------------------------

  // Starts a snapshot; one under way is given up. Nothing may be marked: after Refresh().
  void BeginSnapshot();
  // Saves roots until `bytes` have come together, and moves them to *records, which Load() reads.
  // False when the snapshot is complete.
  bool ContinueSnapshot(std::size_t bytes, std::string* records);
  // All that is saved beside the roots; to be read before them.
  void ArchiveCounters(StateArchive& a);

  // Into an empty map, in any number of pieces, then FinishLoading(). Throws InputError.
  void Load(std::string_view records);
  void FinishLoading();

  NodeId LeafOf(const LeafAddress& address) const;  // kNoNode if there is none

 private:
  class RecordSurfaces;
  static constexpr std::size_t kCacheLine = 64;
  static constexpr std::int64_t kNoPiece = -1;

  static void FetchBytes(const void* object, std::size_t size) {
    const char* bytes = static_cast<const char*>(object);
    for (std::size_t i = 0; i < size; i += kCacheLine) __builtin_prefetch(bytes + i);
  }

  VoxelKey KeyOf(const Eigen::Vector3d& p) const {
    return SlotBase(slot_) + RootKeyOf(p, inverse_root_size_);
  }
  int SlotOfPiece(std::int64_t piece) const;
  void DropStored();
  void DropFixed();
  void DropFixedBelow(NodeId id);
  void TouchTile(VoxelKey tile, std::int64_t change);
  void RemoveRoot(NodeId root);
  // Before anything of a root changes that a snapshot would show, and marks it.
  void Mark(NodeId root) {
    snapshot_.BeforeChange(root, &trees_);
    if (trees_.root(root).marked == 0) MarkLoaded(root);
  }
  void MarkLoaded(NodeId root);
  // A record's root, neither linked nor marked; kNoNode if it is there already.
  NodeId LoadRoot(StateArchive& a);
  // A record that the store gave back.
  void Return(std::string_view record);
  // Evicts until there is room for `reserve` bytes, as far as roots go that have not been touched
  // since.
  std::size_t EvictFor(double reserve, std::uint64_t last_touch);

  // That a frame adds to the window part of a leaf. Returns its root.
  NodeId CountInWindow(NodeId leaf, std::int64_t frame);
  // Adds to a leaf's fixed part and caps its weight.
  void JoinFixed(NodeId leaf, const PointCluster& cluster);
  // What a refresh finds of a node, where more than its own members has to change for it.
  struct PlaneChange {
    NodeId node;
    Surface surface;
  };
  struct TreeSum {
    explicit TreeSum(NodeId node) : id(node) {}

    NodeId id;
    int frames = 0;
    std::size_t end = 0;     // of those below it
    ClusterMoments moments;  // about the root's centre
    Surface surface;         // kEmpty below a planar node
  };
  // What a refresh works with on one thread.
  struct RefreshRoom;
  // Sums of a node and all below it, parents before children.
  void SumTree(NodeId id, std::vector<TreeSum>* sums) const;
  // Brings marked roots [begin, end) up to date, and tells where a plane is to be made or freed.
  void RefreshTrees(std::size_t begin, std::size_t end, RefreshRoom* room,
                    std::vector<PlaneChange>* changes);
  // Has the processor fetch what the next marked roots after i hold.
  void PrefetchTrees(std::size_t i) const;
  // Surfaces of the sums, from the roots down to the coarsest planar nodes.
  void FindSurfaces(RefreshRoom* room) const;
  // What can be said of a node without its eigenvalues; true if that is not all.
  bool BeginSurface(const PointCluster& cluster, int frames, Surface* surface) const;
  void FinishSurface(const Eigen3& eigen, Surface* surface) const;
  // Those of a tile that are in memory, in the order of their keys.
  std::vector<NodeId> RootsOfTile(VoxelKey tile) const;
  void VisitRoot(NodeId root, int min_frames, const VisitSurfel& visit) const;
  static void VisitLeaves(const VoxelTrees& trees, NodeId root, const VisitLeaf& visit);
  void VisitSurfaces(NodeId id, int min_frames, std::int64_t piece, const VisitSurfel& visit) const;
  std::int32_t LastAdded(NodeId id) const;

  VoxelMapOptions options_;
  double inverse_root_size_;
  VoxelStore* store_;
  VoxelTrees trees_;
  std::vector<std::int64_t> pieces_{0};  // by slot
  int slot_ = 0;                         // of the selected piece
  std::vector<NodeId> marked_;
  std::int64_t refreshes_ = 0;

  double bytes_after_eviction_ = 0.0;
  // Touches as they stood after each of the last frames; what was touched since, a recall does not
  // evict.
  std::array<std::uint64_t, 16> recent_touches_ = {};

  bool track_tiles_ = false;
  std::map<int, TileIndex> tiles_;  // by slot; of those dropped, too: a walk may be under way

  MapSnapshot snapshot_;
};

template <>
inline constexpr bool kPlainState<VoxelMap::LeafAddress> = true;
static_assert(sizeof(VoxelMap::LeafAddress) == 16);

}  // namespace lamina
