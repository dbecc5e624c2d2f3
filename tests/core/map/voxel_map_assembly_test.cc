#include <gtest/gtest.h>

#include <set>
#include <tuple>

#include "core/map/voxel_map.h"
#include "tests/support/memory_voxel_store.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

PointCluster Floor(const Eigen::Vector3d& centre, Draws* draws) {
  Points points;
  for (int i = 0; i < 20; ++i) {
    points.push_back(centre + Eigen::Vector3d(draws->Uniform(-0.3, 0.3), draws->Uniform(-0.3, 0.3),
                                              draws->Uniform(-0.005, 0.005)));
  }
  return ClusterOf(points);
}
// The middle of a leaf of 0.8 m.
Eigen::Vector3d Leaf(int x) { return {0.8 * x + 0.4, 0.4, 0.4}; }

int Count(const VoxelMap& map) {
  int count = 0;
  map.ForEachSurface(1, [&](const Surfel&) { ++count; });
  return count;
}

TEST(ReplaceFixed, TheWindowStaysAndTheRestIsWhatIsGiven) {
  Draws draws(1);
  MemoryVoxelStore store;
  VoxelMap map(VoxelMapOptions(), &store);
  const PointCluster in_window = Floor(Leaf(0), &draws), old = Floor(Leaf(0), &draws);
  const VoxelMap::NodeId leaf = map.LeafAt(in_window.mean);
  map.AddFixed(leaf, old, 3, 3);
  map.Hold(leaf);
  map.AddWindow(leaf, in_window, 7);
  for (int x : {10, 20}) map.AddFixed(map.LeafAt(Leaf(x)), Floor(Leaf(x), &draws), 2, 3);
  map.Refresh();
  const PointCluster there = Floor(Leaf(20), &draws), fresh = Floor(Leaf(30), &draws);
  map.ReplaceFixed({{there, 4, 5}, {fresh, 2, 6}});
  EXPECT_EQ(map.FixedAggregate(leaf).count, 0.0);
  EXPECT_EQ(map.Aggregate(leaf).count, in_window.count);
  EXPECT_EQ(map.FindSurface(Leaf(10)), VoxelMap::kNoNode);
  EXPECT_LT(MeanGap(map.Aggregate(map.FindSurface(Leaf(20))), there), 1e-7);
  EXPECT_EQ(map.frames(map.FindSurface(Leaf(20))), 4);
  EXPECT_LT(MeanGap(map.Aggregate(map.FindSurface(Leaf(30))), fresh), 1e-7);
  EXPECT_EQ(Count(map), 3);
  // The frame of the window leaves as ever.
  map.FixWindow(leaf, in_window, 1.0, 7);
  map.Release(leaf);
  map.Refresh();
  EXPECT_EQ(map.FixedAggregate(leaf).count, in_window.count);
  EXPECT_EQ(map.frames(map.FindSurface(in_window.mean)), 1);
}

TEST(ReplaceFixed, WhatWasInTheStoreGoesAndOtherPiecesStay) {
  Draws draws(2);
  MemoryVoxelStore store;
  VoxelMapOptions options;
  options.budget_mb = 1.0;
  VoxelMap map(options, &store);
  map.BeginPiece(1);
  for (const std::int64_t piece : {0, 1}) {
    map.SelectPiece(piece);
    for (int x = 0; x < 8000; x += 4)
      map.AddFixed(map.LeafAt(Leaf(x)), Floor(Leaf(x), &draws), 2, 3);
    map.Refresh();
    map.EvictToBudget();
  }
  const auto of_piece = [&](std::int64_t piece) {
    int count = 0;
    map.ForEachSurface(1, [&](const Surfel& s) { count += s.piece == piece ? 1 : 0; });
    return count;
  };
  ASSERT_GT(store.records(), 2000U);
  ASSERT_EQ(of_piece(0), 2000);
  map.SelectPiece(1);
  map.ReplaceFixed({{Floor(Leaf(2), &draws), 1, 1}});
  EXPECT_EQ(of_piece(0), 2000);
  EXPECT_EQ(of_piece(1), 1);
}

TEST(ReplaceFixed, MoreThanTheBudgetGoesToTheStoreTheLastStay) {
  Draws draws(3);
  MemoryVoxelStore store;
  VoxelMapOptions options;
  options.budget_mb = 2.0;
  VoxelMap map(options, &store);
  std::vector<VoxelMap::FixedPart> parts;
  for (int x = 0; x < 40000; x += 2) parts.push_back({Floor(Leaf(x), &draws), 2, 3});
  map.ReplaceFixed(parts);
  EXPECT_GT(store.records(), 0U);
  EXPECT_NE(map.FindSurface(parts.back().cluster.mean), VoxelMap::kNoNode);
  EXPECT_EQ(map.FindSurface(parts.front().cluster.mean), VoxelMap::kNoNode);
  EXPECT_EQ(Count(map), 20000);
}

}  // namespace
}  // namespace lamina
