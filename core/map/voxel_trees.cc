#include "core/map/voxel_trees.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "core/base/processor.h"
#include "core/geometry/cluster_lanes.h"

namespace lamina {
namespace {

using FourUnsigned = std::uint64_t __attribute__((vector_size(32)));

// Adds `offset` to the largest integers that are not above x: not negative then, as x must be
// smaller than 2^51 and not below -offset.
[[gnu::always_inline]] inline void FloorWithOffset(const Four& x, std::int64_t offset,
                                                   FourUnsigned* floor) {
  // A double of this size has integers alone, the last bits of which are its own.
  constexpr double kInteger = 6755399441055744.0;                        // 3 2^51
  constexpr std::uint64_t kBitsOfInteger = std::uint64_t{0x4338} << 48;  // of that
  const Four one = Four{} + 1.0;
  const Four nearest = (x + kInteger) - kInteger;
  const Four below = nearest - (nearest > x ? one : Four{});
  *floor = reinterpret_cast<FourUnsigned>(below + kInteger) +
           (static_cast<std::uint64_t>(offset) - kBitsOfInteger);
}

// The bits of three numbers of four bits, twenty bits apart, one after the other: bit k of number a
// is bit 3 k + a of the result.
[[gnu::always_inline]] inline void Interleave(FourUnsigned* numbers) {
  constexpr std::uint64_t kEach = 1 | 1 << 20 | std::uint64_t{1} << 40;
  FourUnsigned n = *numbers;
  n = (n | n << 4) & (kEach * 0303);
  n = (n | n << 2) & (kEach * 01111);
  *numbers = (n | n >> 19 | n >> 38) & 07777;
}

}  // namespace

VoxelTrees::VoxelTrees(double root_size_m, int depth)
    : root_size_m_(root_size_m),
      inverse_leaf_size_(1.0 / root_size_m * (1 << depth)),
      depth_(depth),
      most_leaf_((1 << depth) - 1) {}

LAMINA_FOR_EACH_PROCESSOR
void VoxelTrees::PlacesOf(const PointCluster* clusters, std::size_t stride, std::size_t count,
                          const Eigen::Matrix3d& R, const Eigen::Vector3d& t,
                          LeafPlace* places) const {
  MotionLanes at;
  at.Set(R, t);
  for (std::size_t i = 0; i < count; i += 4) {
    const std::size_t left = count - 1 - i;
    const double* means[4];
    for (std::size_t k = 0; k < 4; ++k)
      means[k] = clusters[stride * (i + std::min(k, left))].mean.data();
    Four mu[4];  // the last one is of the scatter
    LoadColumns(means, mu);
    // In the order in which Eigen sums R mean: two rows together and the last one by itself.
    Four x[3];
    for (int a = 0; a < 2; ++a) x[a] = at.R[a][0] * mu[0] + at.R[a][1] * mu[1] + at.R[a][2] * mu[2];
    x[2] = at.R[2][0] * mu[0] + (at.R[2][1] * mu[1] + at.R[2][2] * mu[2]);
    const FourIntegers sign_bit = FourIntegers{} + std::numeric_limits<std::int64_t>::min();
    FourIntegers in_range = ~FourIntegers{};
    for (int a = 0; a < 3; ++a) {
      x[a] = (x[a] + at.t[a]) * inverse_leaf_size_;
      const auto size = reinterpret_cast<Four>(reinterpret_cast<FourIntegers>(x[a]) & ~sign_bit);
      in_range &= size < static_cast<double>((RootKeyLayout::kOffset[a] - 1) << depth_);
    }
    FourUnsigned keys{}, paths{};
    for (int a = 0; a < 3; ++a) {
      FourUnsigned leaf;
      FloorWithOffset(in_range ? x[a] : Four{}, RootKeyLayout::kOffset[a] << depth_, &leaf);
      keys |= leaf >> depth_ << RootKeyLayout::kShift[a];
      paths |= (leaf & static_cast<std::uint64_t>(most_leaf_)) << (20 * a);
    }
    Interleave(&paths);
    keys &= reinterpret_cast<FourUnsigned>(in_range);
    paths &= reinterpret_cast<FourUnsigned>(in_range);
    for (std::size_t k = 0; k < 4 && i + k < count; ++k)
      places[i + k] = {keys[k], static_cast<std::uint32_t>(paths[k])};
  }
}

int VoxelTrees::LevelOf(NodeId id) const {
  int level = 0;
  for (; id >> kKindShift != kRootKind; id = node(id).parent) ++level;
  return level;
}

void VoxelTrees::FitPlane(MapNode* node) {
  const bool wanted = node->kind == Surface::Kind::kPlane;
  if (wanted == (node->plane != kNoNode)) return;
  if (wanted) {
    node->plane = planes_.New();
  } else {
    planes_.Free(std::exchange(node->plane, kNoNode));
  }
}

void VoxelTrees::DropEmptyWindow(MapLeaf* leaf) {
  if (leaf->window == kNoNode || !windows_[leaf->window].Empty()) return;
  windows_.Free(std::exchange(leaf->window, kNoNode));
}

NodeId VoxelTrees::AddRoot(VoxelKey key) {
  const NodeId id = roots_.New() | kRootKind << kKindShift;
  root(id).key = key;
  index_.FindOrInsert(key, id);
  Link(id);
  root(id).touched = ++touches_;
  return id;
}

void VoxelTrees::RemoveRoot(NodeId id) {
  index_.Erase(root(id).key);
  Unlink(id);
  FreeTree(id);
}

NodeId VoxelTrees::ChildAt(NodeId parent, unsigned slot) {
  const NodeId there = children(parent)[slot];
  if (there != kNoNode) return there;
  const bool is_leaf = LevelOf(parent) + 1 == levels();
  const NodeId id = is_leaf ? leaves_.New() : inner_.New() | kInnerKind << kKindShift;
  node(id).parent = parent;
  children(parent)[slot] = id;
  return id;
}

void VoxelTrees::FreeTree(NodeId id) {
  MapNode& freed = node(id);
  freed.kind = Surface::Kind::kEmpty;
  FitPlane(&freed);
  if (IsLeaf(id)) {
    MapLeaf& leaf = leaves_[id];
    if (leaf.window != kNoNode) windows_.Free(leaf.window);
    leaves_.Free(id);
    return;
  }
  for (int slot = 0; slot < 8; ++slot) {
    const NodeId child = children(id)[slot];
    if (child != kNoNode) FreeTree(child);
  }
  const NodeId place = id & kPlaceMask;
  id >> kKindShift == kRootKind ? roots_.Free(place) : inner_.Free(place);
}

void VoxelTrees::Unlink(NodeId id) {
  const MapRoot& n = root(id);
  (n.older == kNoNode ? oldest_ : root(n.older).newer) = n.newer;
  (n.newer == kNoNode ? newest_ : root(n.newer).older) = n.older;
}

void VoxelTrees::Link(NodeId id) {
  MapRoot& n = root(id);
  n.older = newest_;
  n.newer = kNoNode;
  (newest_ == kNoNode ? oldest_ : root(newest_).newer) = id;
  newest_ = id;
}

// --- Trees as bytes --------------------------------------------------------------------------

// A record, little-endian (core/geometry/state_archive.h):
//
//     u64 key of the root    u64 number of its last touch    its tree
//
// and a tree is, for a root or an inner node, a u8 with a bit for each child that is there,
// followed by the trees of these; for a leaf
//
//     u16 fixed_frames   u16 window_frames   i32 last_added   i32 last_fixed
//     u8 bits: 1 it has a fixed cluster: 10 f32, packed; 2 a window part: 10 f64
//
// Planes follow from the clusters and are made again. Holds are for the window to repeat.

void VoxelTrees::SaveTree(StateArchive& a, NodeId id) const {
  if (IsLeaf(id)) {
    MapLeaf copy = leaf(id);
    a(&copy.fixed_frames, &copy.window_frames, &copy.last_added, &copy.last_fixed);
    const ClusterMoments* window = FindWindow(copy);
    auto parts =
        static_cast<std::uint8_t>((copy.fixed.Empty() ? 0 : 1) | (window != nullptr ? 2 : 0));
    a(&parts);
    if ((parts & 1) != 0) a(&copy.fixed);
    if (window == nullptr) return;
    ClusterMoments sums = *window;
    a(&sums);
    return;
  }
  std::uint8_t there = 0;
  for (int slot = 0; slot < 8; ++slot) {
    if (children(id)[slot] != kNoNode) there = static_cast<std::uint8_t>(there | (1U << slot));
  }
  a(&there);
  for (int slot = 0; slot < 8; ++slot) {
    if (children(id)[slot] != kNoNode) SaveTree(a, children(id)[slot]);
  }
}

void VoxelTrees::LoadTree(StateArchive& a, NodeId id, int level) {
  if (level == levels()) {
    MapLeaf& n = leaf(id);
    std::uint8_t parts = 0;
    a(&n.fixed_frames, &n.window_frames, &n.last_added, &n.last_fixed, &parts);
    if ((parts & 1) != 0) a(&n.fixed);
    if ((parts & 2) != 0) a(&Window(&n));
    return;
  }
  std::uint8_t there = 0;
  a(&there);
  for (unsigned slot = 0; slot < 8; ++slot) {
    if ((there & (1U << slot)) != 0) LoadTree(a, ChildAt(id, slot), level + 1);
  }
}

void VoxelTrees::Save(StateArchive& a, NodeId id) const {
  VoxelKey key = root(id).key;
  std::uint64_t touched = root(id).touched;
  a(&key, &touched);
  SaveTree(a, id);
}

NodeId VoxelTrees::Load(StateArchive& a) {
  const NodeId id = roots_.New() | kRootKind << kKindShift;
  try {
    a(&root(id).key, &root(id).touched);
    LoadTree(a, id, 0);
  } catch (const InputError&) {
    FreeTree(id);
    throw;
  }
  if (index_.FindOrInsert(root(id).key, id) == id) return id;
  FreeTree(id);
  return kNoNode;
}

// --- Memory ----------------------------------------------------------------------------------

std::size_t VoxelTrees::bytes() const {
  std::size_t sum = index_.bytes();
  ForEachPool([&](const auto& pool) { sum += pool.bytes(); });
  return sum;
}

double VoxelTrees::used_bytes() const {
  auto sum = static_cast<double>(index_.bytes());
  ForEachPool([&](const auto& pool) { sum += pool.BytesOf(static_cast<double>(pool.used())); });
  return sum;
}

// Blocks of one kind are of no use to another: what a kind once took stays its own, and only what
// it needs beyond that makes memory grow.
bool VoxelTrees::HasRoom(double more_bytes, double most_bytes) const {
  const double used = used_bytes();
  if (used + more_bytes > most_bytes) return false;
  const double share = more_bytes / std::max(1.0, used - static_cast<double>(index_.bytes()));
  auto taken = static_cast<double>(index_.bytes());
  double growth = 0.0;
  ForEachPool([&](const auto& pool) {
    const auto most = static_cast<double>(pool.most_used());
    taken += pool.BytesOf(most);
    growth += pool.BytesOf(std::max(0.0, (1.0 + share) * static_cast<double>(pool.used()) - most));
  });
  return growth <= std::max(0.0, most_bytes - taken);
}

void VoxelTrees::ArchiveCounters(StateArchive& a) {
  std::uint64_t index_size = index_.expected_size();
  a(&touches_, &index_size);
  if (a.reading()) index_ = VoxelIndex(static_cast<std::size_t>(index_size));
  const auto archive = [&a](auto* pool) {
    std::uint64_t most_used = pool->most_used();
    a(&most_used);
    pool->ContinueFrom(static_cast<std::size_t>(most_used));
  };
  archive(&leaves_), archive(&inner_), archive(&roots_), archive(&planes_), archive(&windows_);
}

}  // namespace lamina
