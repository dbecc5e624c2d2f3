#include "core/map/tile_index.h"

#include <gtest/gtest.h>

#include <array>
#include <map>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

constexpr double kTileM = 2.0;

using Place = std::array<int, 3>;

Eigen::Vector3i At(const Place& p) { return {p[0], p[1], p[2]}; }
Place PlaceOf(const TileIndex::Walk::Tile& tile) {
  return {tile.place.x(), tile.place.y(), tile.place.z()};
}

double Distance(const Place& p, const Eigen::Vector3d& centre) {
  const Eigen::Vector3d low = kTileM * At(p).cast<double>();
  const Eigen::Vector3d high = low + Eigen::Vector3d::Constant(kTileM);
  return (centre.cwiseMax(low).cwiseMin(high) - centre).norm();
}

std::vector<TileIndex::Walk::Tile> All(TileIndex::Walk walk) {
  std::vector<TileIndex::Walk::Tile> tiles;
  for (TileIndex::Walk::Tile tile; walk.Next(&tile);) tiles.push_back(tile);
  return tiles;
}

TEST(TileIndex, WalksFromNearToFarOverWhatHasChanged) {
  Draws draws(1);
  for (int trial = 0; trial < 40; ++trial) {
    TileIndex index;
    std::map<Place, std::int64_t> places;
    const int reach = trial % 4 == 0 ? 100000 : 12;
    for (int i = 0; i < 300; ++i) {
      const Place place{draws.Integer(-reach, reach), draws.Integer(-reach, reach),
                        draws.Integer(-3, 3)};
      const int change = i / 10;
      places[place] = change;
      index.Touch(At(place), change);
    }
    EXPECT_EQ(index.tiles(), places.size());
    const Eigen::Vector3d centre = draws.InCube(10.0);
    const double radius = trial % 5 == 0 ? 1e6 : draws.Uniform(0.0, 20.0);
    for (const std::int64_t newer_than : {-1, 0, 20, 29}) {
      std::map<Place, double> expected;
      for (const auto& [place, change] : places) {
        const double distance = Distance(place, centre);
        if (change > newer_than && distance <= radius) expected[place] = distance;
      }
      const auto tiles = All({index, kTileM, centre, radius, newer_than, 0});
      EXPECT_EQ(tiles.size(), expected.size());
      double last = 0.0;
      for (const auto& tile : tiles) {
        ASSERT_EQ(expected.count(PlaceOf(tile)), 1U);
        EXPECT_GE(expected[PlaceOf(tile)], last - 1e-9 * radius);
        last = expected[PlaceOf(tile)];
      }
      // From any rank on, the same.
      if (tiles.empty()) continue;
      const auto from = static_cast<std::size_t>(draws.Integer(0, int(tiles.size()) - 1));
      const auto rest = All({index, kTileM, centre, radius, newer_than, tiles[from].rank});
      ASSERT_GE(rest.size(), tiles.size() - from);
      for (std::size_t i = 0; i < tiles.size() - from; ++i) {
        EXPECT_EQ(PlaceOf(rest[rest.size() - 1 - i]), PlaceOf(tiles[tiles.size() - 1 - i]));
      }
    }
  }
}

// A street of tiles in a sphere that has room for 4 million: looking at 50 of them takes as many
// looks wherever it begins, and nothing new takes none.
TEST(TileIndex, AWalkCostsWhatItMeets) {
  TileIndex index;
  for (int x = -2000; x < 2000; ++x) {
    for (int z = 0; z < 2; ++z) index.Touch({x, 0, z}, 5);
  }
  index.Touch({70, 0, 0}, 6);
  const Eigen::Vector3d centre(0.3, 0.2, 0.1);
  constexpr double kRadiusM = 200.0;
  const auto count = All({index, kTileM, centre, kRadiusM, -1, 0}).size();
  EXPECT_NEAR(static_cast<double>(count), 402.0, 4.0);
  for (const double share : {0.0, 0.3, 0.9}) {
    const auto rank = static_cast<std::uint32_t>(share * TileIndex::Walk::kMostRank);
    TileIndex::Walk walk(index, kTileM, centre, kRadiusM, -1, rank);
    TileIndex::Walk::Tile tile;
    for (int i = 0; i < 30; ++i) ASSERT_TRUE(walk.Next(&tile));
    EXPECT_LT(walk.looked_at(), 300U) << share;
  }
  TileIndex::Walk nothing(index, kTileM, centre, kRadiusM, 6, 0);
  TileIndex::Walk::Tile tile;
  EXPECT_FALSE(nothing.Next(&tile));
  EXPECT_LE(nothing.looked_at(), 8U);
  TileIndex::Walk one(index, kTileM, centre, kRadiusM, 5, 0);
  ASSERT_TRUE(one.Next(&tile));
  EXPECT_EQ(PlaceOf(tile), (Place{70, 0, 0}));
  EXPECT_EQ(tile.change, 6);
  EXPECT_FALSE(one.Next(&tile));
  EXPECT_LT(one.looked_at(), 300U);
}

}  // namespace
}  // namespace lamina
