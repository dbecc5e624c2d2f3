#include "core/map/tile_index.h"

#include <algorithm>
#include <cmath>

namespace lamina {
namespace {

constexpr int kBits = 2;  // of the place of a child, along an axis
constexpr VoxelKey kLast = (VoxelKey{1} << kBits) - 1;
constexpr VoxelKey kIndexMask = (VoxelKey{1} << kVoxelKeyBits) - 1;
constexpr int kShift[3] = {2 * kVoxelKeyBits, kVoxelKeyBits, 0};

// Of an index in a key, offset to be positive.
std::int64_t IndexOf(VoxelKey key, int axis) {
  return static_cast<std::int64_t>((key >> kShift[axis]) & kIndexMask);
}

VoxelKey ParentOf(VoxelKey key) {
  VoxelKey parent = 0;
  for (const int shift : kShift) parent |= (((key >> shift) & kIndexMask) >> kBits) << shift;
  return parent;
}

// Which child of its parent a cube is.
int ChildSlotOf(VoxelKey key) {
  int slot = 0;
  for (const int shift : kShift) {
    slot = slot << kBits | static_cast<int>((key >> shift) & kLast);
  }
  return slot;
}

VoxelKey ChildOf(VoxelKey parent, int slot) {
  VoxelKey key = parent << kBits;
  for (int axis = 2; axis >= 0; --axis, slot >>= kBits) {
    key |= (static_cast<VoxelKey>(slot) & kLast) << kShift[axis];
  }
  return key;
}

}  // namespace

void TileIndex::Touch(const Eigen::Vector3i& tile, std::int64_t change) {
  VoxelKey key = PackVoxelKey(tile.x(), tile.y(), tile.z());
  int child_slot = -1;
  for (Level& level : levels_) {
    const auto next = static_cast<std::int32_t>(level.cubes.size());
    const std::int32_t id = level.index.FindOrInsert(key, next);
    if (id == next) level.cubes.push_back({key, 0, -1});
    Cube& cube = level.cubes[static_cast<std::size_t>(id)];
    const std::uint64_t child = child_slot < 0 ? 0 : std::uint64_t{1} << child_slot;
    // What is above knows both already.
    if (cube.change >= change && (cube.children & child) == child) return;
    cube.children |= child;
    cube.change = std::max(cube.change, change);
    child_slot = ChildSlotOf(key);
    key = ParentOf(key);
  }
}

TileIndex::Walk::Walk(const TileIndex& index, double tile_size_m, const Eigen::Vector3d& centre,
                      double radius_m, std::int64_t newer_than, std::uint32_t from_rank)
    : index_(index),
      tile_size_m_(tile_size_m),
      centre_(centre),
      radius_m_(radius_m),
      newer_than_(newer_than),
      from_rank_(from_rank) {
  for (const Cube& cube : index.levels_.back().cubes) Add(kLevels - 1, cube.key);
}

bool TileIndex::Walk::Next(Tile* tile) {
  while (!candidates_.empty()) {
    const Candidate nearest = candidates_.top();
    candidates_.pop();
    const Cube& cube = index_.levels_[static_cast<std::size_t>(nearest.level)]
                           .cubes[static_cast<std::size_t>(nearest.cube)];
    if (nearest.level == 0) {
      for (int axis = 0; axis < 3; ++axis) {
        tile->place(axis) = static_cast<int>(IndexOf(cube.key, axis) - kVoxelKeyOffset);
      }
      tile->rank = nearest.rank;
      tile->change = cube.change;
      return true;
    }
    for (std::uint64_t left = cube.children; left != 0; left &= left - 1) {
      Add(nearest.level - 1, ChildOf(cube.key, __builtin_ctzll(left)));
    }
  }
  return false;
}

void TileIndex::Walk::Add(int level, VoxelKey key) {
  ++looked_at_;
  const Level& cubes = index_.levels_[static_cast<std::size_t>(level)];
  const std::int32_t id = cubes.index.Find(key);
  if (cubes.cubes[static_cast<std::size_t>(id)].change <= newer_than_) return;
  const double tiles = std::ldexp(1.0, kBits * level);  // along its edge
  Eigen::Vector3d low;
  for (int axis = 0; axis < 3; ++axis) {
    low(axis) =
        static_cast<double>(IndexOf(key, axis)) * tiles - static_cast<double>(kVoxelKeyOffset);
  }
  const Eigen::Vector3d corner = tile_size_m_ * low;
  const Eigen::Vector3d opposite = tile_size_m_ * (low.array() + tiles).matrix();
  const double distance = (centre_.cwiseMax(corner).cwiseMin(opposite) - centre_).norm();
  if (!(distance <= radius_m_)) return;
  const auto rank_of = [this](double d) {
    const double share = radius_m_ > 0.0 ? std::min(1.0, d / radius_m_) : 0.0;
    return static_cast<std::uint32_t>(share * kMostRank);
  };
  const std::uint32_t rank = rank_of(distance);
  if (level == 0) {
    if (rank < from_rank_) return;
  } else {
    // All of it is nearer than where the walk begins.
    const double farthest =
        (centre_ - corner).cwiseAbs().cwiseMax((centre_ - opposite).cwiseAbs()).norm();
    if (farthest < radius_m_ && rank_of(farthest) < from_rank_) return;
  }
  candidates_.push({rank, level, id, key});
}

}  // namespace lamina
