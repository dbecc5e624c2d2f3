// Roots of the map as bytes: snapshots, the store, addresses.
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "core/map/voxel_map.h"
#include "tests/support/memory_voxel_store.h"
#include "tests/support/saved_map.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

using NodeId = VoxelMap::NodeId;

VoxelMapOptions Options(double budget_mb = 100.0) {
  VoxelMapOptions options;
  options.depth = 2;
  options.budget_mb = budget_mb;
  return options;
}

// Gives a map patches to hold, some of them fixed and some in the window, for ever new frames.
class Filler {
 public:
  explicit Filler(std::uint64_t seed) : draws_(static_cast<unsigned>(seed)) {}

  void Add(int patches, double size_m, VoxelMap* map) {
    for (int i = 0; i < patches; ++i) {
      const Patch patch(draws_.InCube(size_m), draws_.Direction());
      PointCluster cluster;
      for (int k = 0; k < 12; ++k) cluster.AddPoint(patch.Point(0.1, 0.005, &draws_));
      const NodeId leaf = map->LeafAt(cluster.mean);
      map->AddWindow(leaf, cluster, frame_);
      if (i % 3 == 0) map->FixWindow(leaf, cluster, 1.0, frame_);
    }
    ++frame_;
    map->Refresh();
    map->EvictToBudget();
  }

 private:
  Draws draws_;
  std::int64_t frame_ = 0;
};

void Load(const std::string& records, VoxelMap* saved, VoxelMap* map) {
  StateArchive writer;
  saved->ArchiveCounters(writer);
  StateArchive reader(writer.written());
  map->ArchiveCounters(reader);
  map->Load(records);
  map->FinishLoading();
}

// What a map shows, in its order, to the last bit.
std::string Shown(const VoxelMap& map) {
  std::string text;
  map.ForEachSurface(1, [&](const Surfel& s) {
    StateArchive a;
    Surfel copy = s;
    a(&copy.centre, &copy.normal, &copy.eigenvalues, &copy.count, &copy.last_keyframe);
    text += a.written();
  });
  return text;
}

TEST(VoxelMapRecords, ALoadedMapGoesOnAsTheOneThatWasSaved) {
  VoxelMap map(Options(2.0));
  Filler filler(1), copy_filler(1);
  for (int i = 0; i < 30; ++i) filler.Add(300, 20.0 + i, &map);
  VoxelMap loaded(Options(2.0));
  Load(Saved(&map), &map, &loaded);
  ASSERT_GT(map.roots(), 500U);
  EXPECT_EQ(loaded.roots(), map.roots());
  EXPECT_EQ(loaded.nodes(), map.nodes());
  EXPECT_EQ(Shown(loaded), Shown(map));
  // Frames that evict much: the same roots in both.
  VoxelMap unused(Options(2.0));
  for (int i = 0; i < 30; ++i) copy_filler.Add(300, 20.0 + i, &unused);
  for (int i = 0; i < 20; ++i) {
    filler.Add(300, 40.0, &map);
    copy_filler.Add(300, 40.0, &loaded);
    ASSERT_EQ(Shown(loaded), Shown(map)) << "frame " << i;
  }
}

TEST(VoxelMapRecords, ASnapshotShowsTheMapAsItWasWhenItBegan) {
  MemoryVoxelStore store;
  VoxelMap map(Options(3.0), &store);
  Filler filler(2);
  for (int i = 0; i < 40; ++i) filler.Add(300, 25.0, &map);
  const std::string before = Shown(map);
  const std::size_t records_before = store.records();
  const std::string whole = Saved(&map);
  map.BeginSnapshot();
  std::string all, records;
  int pieces = 0;
  for (bool more = true; more; ++pieces) {
    filler.Add(5, 35.0, &map);  // changes, new roots, evictions, returns from the store
    more = map.ContinueSnapshot(5000, &records);
    all += records;
  }
  EXPECT_GT(pieces, 5);
  EXPECT_NE(store.records(), records_before);
  EXPECT_EQ(all.size(), whole.size());
  VoxelMap from_whole(Options(3.0)), from_pieces(Options(3.0));
  Load(whole, &map, &from_whole);
  Load(all, &map, &from_pieces);
  EXPECT_EQ(Shown(from_pieces), Shown(from_whole));
  EXPECT_EQ(before.substr(0, Shown(from_whole).size()), Shown(from_whole));
}

TEST(VoxelMapRecords, WhatLeftMemoryComesBackWithNothingLost) {
  MemoryVoxelStore store;
  VoxelMap small(Options(2.0), &store), large(Options());
  Filler filler(3), copy(3);
  for (int i = 0; i < 90; ++i) {
    filler.Add(100, 30.0, &small);
    copy.Add(100, 30.0, &large);
  }
  ASSERT_GT(store.records(), 500U);
  EXPECT_LT(small.roots(), large.roots());
  EXPECT_EQ(small.roots() + store.records(), large.roots());
  // The same surfaces, in another order.
  const auto all = [](const VoxelMap& map) {
    std::multiset<std::string> surfels;
    map.ForEachSurface(1, [&](const Surfel& s) {
      StateArchive a;
      Surfel copied = s;
      a(&copied.centre, &copied.normal, &copied.count);
      surfels.insert(a.written());
    });
    return surfels;
  };
  EXPECT_EQ(all(small), all(large));
}

TEST(VoxelMapRecords, RecallBringsBackWhatLiesAroundPoints) {
  MemoryVoxelStore store;
  VoxelMap map(Options(2.0), &store);
  Filler filler(4);
  const Eigen::Vector3d place(0.5, 0.5, 0.5);
  PointCluster cluster;
  Draws draws(5);
  const Patch patch(place, {0.0, 0.0, 1.0});
  for (int k = 0; k < 20; ++k) cluster.AddPoint(patch.Point(0.1, 0.001, &draws));
  map.AddWindow(map.LeafAt(place), cluster, 0);
  map.Refresh();
  while (map.FindSurface(place) != VoxelMap::kNoNode) filler.Add(300, 300.0, &map);
  EXPECT_EQ(map.Recall({{1e9, 0.0, 0.0}, {-900.0, 0.0, 0.0}}), 0U);
  EXPECT_GE(map.Recall({place, place}), 1U);
  const NodeId id = map.FindSurface(place);
  ASSERT_NE(id, VoxelMap::kNoNode);
  EXPECT_EQ(map.kind(id), Surface::Kind::kPlane);
  EXPECT_EQ(map.Aggregate(id).count, 20.0);
  EXPECT_EQ(map.Recall({place}), 0U);
}

TEST(VoxelMapRecords, LeavesAreFoundAgainByTheirAddress) {
  VoxelMap map(Options());
  Draws draws(6);
  std::map<NodeId, Eigen::Vector3d> leaves;
  std::map<NodeId, VoxelMap::LeafAddress> addresses;
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d p = draws.InCube(30.0);
    VoxelMap::LeafAddress address;
    const NodeId leaf = map.LeafAt(p, &address);
    leaves[leaf] = p;
    addresses[leaf] = address;
  }
  VoxelMap loaded(Options());
  Load(Saved(&map), &map, &loaded);
  for (const auto& [leaf, p] : leaves) {
    const VoxelMap::LeafAddress address = addresses.at(leaf);
    EXPECT_EQ(map.LeafOf(address), leaf);
    const NodeId nodes = static_cast<NodeId>(loaded.nodes());
    EXPECT_EQ(loaded.LeafOf(address), loaded.LeafAt(p));
    EXPECT_EQ(static_cast<NodeId>(loaded.nodes()), nodes);  // LeafAt made no new one
  }
  EXPECT_EQ(map.LeafOf({RootKeyOf({900.0, 0.0, 0.0}, 1.0), 0}), VoxelMap::kNoNode);
}

TEST(VoxelMapRecords, TilesShowWhatChangedSince) {
  MemoryVoxelStore store;
  VoxelMap map(Options(2.0), &store);
  Filler filler(7);
  for (int i = 0; i < 40; ++i) filler.Add(300, 30.0, &map);
  ASSERT_FALSE(store.Empty());
  std::set<VoxelKey> tiles;
  std::size_t all = 0, by_tile = 0, again = 0;
  map.ForEachSurface(1, [&](const Surfel& s) {
    ++all;
    tiles.insert(map.TileAround(s.centre));
  });
  for (const VoxelKey tile : tiles) {
    map.ForEachSurfaceOfTile(tile, -1, 1, [&](const Surfel&) { ++by_tile; });
    map.ForEachSurfaceOfTile(tile, map.refreshes(), 1, [&](const Surfel&) { ++again; });
  }
  EXPECT_EQ(by_tile, all);
  EXPECT_EQ(again, 0U);
}

TEST(VoxelMapRecords, BytesThatEndTooEarlyAreAnError) {
  VoxelMap map(Options());
  Filler filler(8);
  filler.Add(100, 20.0, &map);
  const std::string records = Saved(&map);
  VoxelMap loaded(Options());
  EXPECT_THROW(loaded.Load(std::string_view(records).substr(0, records.size() - 1)), InputError);
}

}  // namespace
}  // namespace lamina
