// The tiles of a map that have anything in them, and a walk over those around a place from near to
// far, which costs no more than the tiles that it meets.
//
// Tiles are cubes of one size, named by their indices along the axes: tile (x, y, z) has its lower
// corner at (x, y, z) times that size. They are the leaves of a tree of cubes, each of 4 x 4 x 4 of
// the next smaller ones, of which only those exist in which there is a tile. Each knows the newest
// change below it, so that a walk passes over what has not changed.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <queue>
#include <vector>

#include "core/map/voxel_key.h"

namespace lamina {

// One thread at a time; const members may run at once.
class TileIndex {
 public:
  // `change` numbers the changes of the map and does not go down; 0: as the map was found. Indices
  // must lie in [-2^20, 2^20).
  void Touch(const Eigen::Vector3i& tile, std::int64_t change);

  std::size_t tiles() const { return levels_[0].cubes.size(); }

  // Visits tiles that touch a sphere, from near to far. May go on after further changes: what is
  // new since then may be left out.
  class Walk {
   public:
    struct Tile {
      Eigen::Vector3i place;
      // Distance of the tile from the centre in parts of the radius, [0, kMostRank]. Far fewer
      // tiles than a page holds have the same one.
      std::uint32_t rank = 0;
      std::int64_t change = 0;
    };
    static constexpr std::uint32_t kMostRank = std::numeric_limits<std::uint32_t>::max() - 1;

    // Of tiles that have changed since `newer_than` (-1: all), from this rank on.
    Walk(const TileIndex& index, double tile_size_m, const Eigen::Vector3d& centre, double radius_m,
         std::int64_t newer_than, std::uint32_t from_rank);

    // False if there are no more.
    bool Next(Tile* tile);
    // Cubes looked at so far: what the walk has cost.
    std::size_t looked_at() const { return looked_at_; }

   private:
    // Nearest first; cubes before tiles, for these may be in them.
    struct Candidate {
      std::uint32_t rank;
      int level;
      std::int32_t cube;
      VoxelKey key;
      bool operator<(const Candidate& other) const {
        if (rank != other.rank) return rank > other.rank;
        if (level != other.level) return level < other.level;
        return key > other.key;
      }
    };
    void Add(int level, VoxelKey key);

    const TileIndex& index_;
    double tile_size_m_;
    Eigen::Vector3d centre_;
    double radius_m_;
    std::int64_t newer_than_;
    std::uint32_t from_rank_;
    std::size_t looked_at_ = 0;
    std::priority_queue<Candidate> candidates_;
  };

 private:
  struct Cube {
    VoxelKey key = 0;            // PackVoxelKey of the place, each index halved 2 * level times
    std::uint64_t children = 0;  // a bit for each
    std::int64_t change = -1;
  };
  struct Level {
    VoxelIndex index;
    std::vector<Cube> cubes;
  };
  // Level 0 are the tiles; on the last one an index has one bit left.
  static constexpr int kLevels = (kVoxelKeyBits + 1) / 2;

  std::array<Level, kLevels> levels_;
};

}  // namespace lamina
