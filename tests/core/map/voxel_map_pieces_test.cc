// Pieces of a map that lie in one place.
#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <sstream>
#include <string>

#include "core/map/voxel_map.h"
#include "tests/core/map/voxel_map_fixture.h"
#include "tests/support/memory_voxel_store.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

using NodeId = VoxelMap::NodeId;

// What the map shows of each piece, as text.
std::map<std::int64_t, std::string> SurfacesOf(const VoxelMap& map) {
  std::map<std::int64_t, std::string> shown;
  map.ForEachSurface(1, [&](const Surfel& s) {
    std::ostringstream text;
    text << s.centre.transpose() << " " << s.count << "\n";
    shown[s.piece] += text.str();
  });
  return shown;
}

TEST(VoxelMap, PiecesInOnePlaceDoNotSeeEachOther) {
  constexpr std::int64_t kPieces = 5;
  MemoryVoxelStore store;
  VoxelMapOptions options = OnlyPlanes();
  options.budget_mb = 1.0;  // some of it goes to the store and comes back
  VoxelMap together(options, &store);
  std::vector<std::unique_ptr<VoxelMap>> alone;
  std::vector<Draws> draws;
  for (std::int64_t piece = 0; piece < kPieces; ++piece) {
    if (piece > 0) together.BeginPiece(piece);
    alone.push_back(std::make_unique<VoxelMap>(OnlyPlanes()));
    draws.emplace_back(static_cast<unsigned>(piece));
  }
  const auto find = [](const VoxelMap& map, const Eigen::Vector3d& p) {
    const NodeId id = map.FindSurface(p);
    return id == VoxelMap::kNoNode ? Eigen::Vector3d::Zero() : map.Aggregate(id).mean;
  };
  for (int i = 0; i < 1200; ++i) {
    const std::int64_t piece = i % kPieces;
    const Patch patch(draws[static_cast<std::size_t>(piece)].InCube(25.0),
                      Eigen::Vector3d::UnitZ());
    Points points;
    for (int k = 0; k < 30; ++k)
      points.push_back(patch.Point(0.2, 0.005, &draws[static_cast<std::size_t>(piece)]));
    together.SelectPiece(piece);
    VoxelMap& own = *alone[static_cast<std::size_t>(piece)];
    for (VoxelMap* map : {&together, &own}) {
      AddPoints(points, i, map);
      map->Refresh();
      map->EvictToBudget();
    }
    together.Recall({points[0]});
    EXPECT_EQ(find(together, points[0]), find(own, points[0]));
  }
  EXPECT_FALSE(store.Empty());
  const auto shown = SurfacesOf(together);
  ASSERT_EQ(shown.size(), std::size_t{kPieces});
  for (const auto& [piece, text] : shown) {
    const auto lines = [](std::string all) {
      std::multiset<std::string> set;
      std::istringstream in(all);
      for (std::string line; std::getline(in, line);) set.insert(line);
      return set;
    };
    EXPECT_EQ(lines(text), lines(SurfacesOf(*alone[static_cast<std::size_t>(piece)]).at(0)));
  }
}

TEST(VoxelMap, WhatIsDroppedOfAPieceMakesRoomForAnother) {
  VoxelMap map(OnlyPlanes());
  Draws draws(4);
  const auto add = [&](std::vector<VoxelKey>* roots) {
    VoxelMap::LeafAddress address;
    const Points points = draws.Cloud(30, {0.4, 0.4, 0.4}, 0.1);
    map.AddWindow(map.LeafAt(points[0], &address), ClusterOf(points), 0);
    map.Refresh();
    roots->push_back(address.root);
  };
  std::vector<VoxelKey> kept, dropped;
  add(&kept);
  for (std::int64_t piece = 1; piece < 3 * kMostSlots; ++piece) {
    ASSERT_TRUE(map.RoomForPiece());
    map.BeginPiece(piece);
    EXPECT_EQ(map.FindSurface({0.4, 0.4, 0.4}), VoxelMap::kNoNode);
    dropped.clear();
    add(&dropped);
    EXPECT_EQ(map.roots(), 2U);
    map.DropPiece(piece, dropped);
  }
  EXPECT_EQ(map.roots(), 1U);
  map.SelectPiece(0);
  EXPECT_NE(map.FindSurface({0.4, 0.4, 0.4}), VoxelMap::kNoNode);
  EXPECT_THROW(map.SelectPiece(1), std::logic_error);
  for (std::int64_t piece = 1; piece < kMostSlots; ++piece) map.BeginPiece(piece);
  EXPECT_FALSE(map.RoomForPiece());
}

// As a start that is given up right after a scan has come.
TEST(VoxelMap, APieceThatIsDroppedUnrefreshedLeavesNothing) {
  VoxelMap map(OnlyPlanes());
  Draws draws(4);
  std::size_t bytes = 0;
  for (std::int64_t piece = 0; piece < 200; ++piece) {
    if (piece > 0) map.BeginPiece(piece);
    map.SelectPiece(piece);
    std::vector<VoxelKey> roots;
    for (int i = 0; i < 40; ++i) {
      const Patch patch(draws.InCube(20.0), Eigen::Vector3d::UnitZ());
      for (int k = 0; k < 20; ++k) {
        VoxelMap::LeafAddress address;
        const Eigen::Vector3d p = patch.Point(0.2, 0.005, &draws);
        map.AddWindow(map.LeafAt(p, &address), ClusterOf({p}), 0);
        roots.push_back(address.root);
      }
    }
    map.DropPiece(piece, roots);
    map.Refresh();
    ASSERT_EQ(map.roots(), 0U);
    map.ForEachSurface(1, [](const Surfel&) { FAIL() << "a surface of a dropped piece"; });
    if (piece == 20) bytes = map.bytes();
  }
  EXPECT_LT(map.bytes(), bytes + bytes / 5);
}

}  // namespace
}  // namespace lamina
