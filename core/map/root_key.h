// Keys of the map's root voxels: a piece of the map and a voxel of its frame in one word.
//
//     bits 62..52 slot of the piece   51..33 x   32..14 y   13..0 z
//
// Indices of voxels are offset to be positive. The pieces of a map are not connected: each has a
// frame of its own, and may lie anywhere in the frame of any other. A slot for each keeps them
// apart in one index and one store, while all coordinates stay those of the piece's own frame: with
// voxels of 1 m, 262 km to each side of its origin and 8 km up and down. Keys of one slot are
// ordered as the indices (x, y, z).
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>

#include "core/map/voxel_key.h"

namespace lamina {

struct RootKeyLayout {
  static constexpr int kSlotBits = 11, kHorizontalBits = 19, kVerticalBits = 14;
  static constexpr int kShift[3] = {kHorizontalBits + kVerticalBits, kVerticalBits, 0};
  static constexpr int kSlotShift = 2 * kHorizontalBits + kVerticalBits;
  static constexpr std::int64_t kOffset[3] = {std::int64_t{1} << (kHorizontalBits - 1),
                                              std::int64_t{1} << (kHorizontalBits - 1),
                                              std::int64_t{1} << (kVerticalBits - 1)};
  static constexpr VoxelKey Mask(int axis) { return static_cast<VoxelKey>(2 * kOffset[axis] - 1); }
};
inline constexpr int kMostSlots = 1 << RootKeyLayout::kSlotBits;

// What is added to the key of a voxel in slot 0 to have it in another one.
inline constexpr VoxelKey SlotBase(int slot) {
  return static_cast<VoxelKey>(slot) << RootKeyLayout::kSlotShift;
}
inline int SlotOf(VoxelKey key) { return static_cast<int>(key >> RootKeyLayout::kSlotShift); }

// Of the voxel around p in slot 0; p must be in range.
inline VoxelKey RootKeyOf(const Eigen::Vector3d& p, double inverse_size) {
  VoxelKey key = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const auto index = static_cast<std::int64_t>(std::floor(p[axis] * inverse_size));
    key |= static_cast<VoxelKey>(index + RootKeyLayout::kOffset[axis])
           << RootKeyLayout::kShift[axis];
  }
  return key;
}

inline bool IsRootKeyInRange(const Eigen::Vector3d& p, double inverse_size) {
  // False for NaN, too: every comparison with it is.
  for (int axis = 0; axis < 3; ++axis) {
    const auto most = static_cast<double>(RootKeyLayout::kOffset[axis] - 1);
    if (!(std::abs(p[axis] * inverse_size) < most)) return false;
  }
  return true;
}

// In the frame of its piece.
inline Eigen::Vector3d RootCentre(VoxelKey key, double size) {
  Eigen::Vector3d centre;
  for (int axis = 0; axis < 3; ++axis) {
    const VoxelKey index = (key >> RootKeyLayout::kShift[axis]) & RootKeyLayout::Mask(axis);
    centre[axis] =
        size *
        (static_cast<double>(static_cast<std::int64_t>(index) - RootKeyLayout::kOffset[axis]) +
         0.5);
  }
  return centre;
}

// Tiles: cubes of 4 x 4 x 4 voxels, named by keys of the same form (each index, offset, divided by
// 4).
inline constexpr int kTileBits = 2;
inline VoxelKey TileOf(VoxelKey key) {
  VoxelKey tile = SlotBase(SlotOf(key));
  for (int axis = 0; axis < 3; ++axis) {
    const int shift = RootKeyLayout::kShift[axis];
    tile |= (((key >> shift) & RootKeyLayout::Mask(axis)) >> kTileBits) << shift;
  }
  return tile;
}
// The tile by its indices, which are those of its lower corner in tiles, and back.
inline VoxelKey TileAtPlace(const Eigen::Vector3i& place, int slot) {
  VoxelKey tile = SlotBase(slot);
  for (int axis = 0; axis < 3; ++axis) {
    tile |= static_cast<VoxelKey>(place[axis] + (RootKeyLayout::kOffset[axis] >> kTileBits))
            << RootKeyLayout::kShift[axis];
  }
  return tile;
}
inline Eigen::Vector3i PlaceOfTile(VoxelKey tile) {
  Eigen::Vector3i place;
  for (int axis = 0; axis < 3; ++axis) {
    const VoxelKey index = (tile >> RootKeyLayout::kShift[axis]) & RootKeyLayout::Mask(axis);
    place[axis] = static_cast<int>(static_cast<std::int64_t>(index) -
                                   (RootKeyLayout::kOffset[axis] >> kTileBits));
  }
  return place;
}
// The voxel of a tile that is i steps along x, j along y and k along z from its first one; each of
// them from 0 to 3.
inline VoxelKey VoxelOfTile(VoxelKey tile, int i, int j, int k) {
  const VoxelKey slot = SlotBase(SlotOf(tile));
  const int step[3] = {i, j, k};
  VoxelKey key = slot + ((tile - slot) << kTileBits);
  for (int axis = 0; axis < 3; ++axis) {
    key += static_cast<VoxelKey>(step[axis]) << RootKeyLayout::kShift[axis];
  }
  return key;
}

}  // namespace lamina
