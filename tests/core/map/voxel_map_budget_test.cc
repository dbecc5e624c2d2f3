// Memory of the map: what a leaf costs, and what the budget promises.
#include <gtest/gtest.h>

#include <algorithm>

#include "core/map/voxel_map.h"
#include "tests/support/memory_voxel_store.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

constexpr double kMiB = 1048576.0;

// Cuts a scan of points into leaves, as frames of the window do, and fixes them.
class Builder {
 public:
  Builder(VoxelMap* map, unsigned seed) : map_(map), draws_(seed) {}

  // A piece of a wall or a floor, `points` points in a square of edge 2 `half_m`.
  void AddPatch(const Eigen::Vector3d& centre, const Eigen::Vector3d& normal, double half_m,
                double sigma_m, int points) {
    const Patch patch(centre, normal);
    for (int i = 0; i < points; ++i) Add(patch.Point(half_m, sigma_m, &draws_));
  }
  void AddClutter(const Eigen::Vector3d& centre, double size_m, int points) {
    for (const Eigen::Vector3d& p : draws_.Cloud(points, centre, size_m)) Add(p);
  }
  // What was added since becomes part of the map for good, or stays in the window.
  void End(bool fix) {
    for (const auto& [leaf, cluster] : added_) {
      if (fix) map_->FixWindow(leaf, cluster, 1.0, frame_);
    }
    added_.clear();
    ++frame_;
    map_->Refresh();
  }

 private:
  void Add(const Eigen::Vector3d& p) {
    PointCluster point;
    point.AddPoint(p);
    const VoxelMap::NodeId leaf = map_->LeafAt(p);
    map_->AddWindow(leaf, point, frame_);
    added_.emplace_back(leaf, point);
  }

  VoxelMap* map_;
  Draws draws_;
  std::vector<std::pair<VoxelMap::NodeId, PointCluster>> added_;
  std::int64_t frame_ = 0;
};

// A flat patch in the root voxel with these indices, seen by two frames.
void AddPatch(int x, int y, int z, std::int64_t frame, Draws* draws, VoxelMap* map) {
  const double size = map->options().root_size_m;
  const Patch patch(size * Eigen::Vector3d(x + 0.5, y + 0.5, z + 0.5), draws->Direction());
  for (int f = 0; f < 2; ++f) {
    Points points;
    for (int i = 0; i < 10; ++i) points.push_back(patch.Point(0.3 * size, 0.001, draws));
    map->AddWindow(map->LeafAt(patch.centre), ClusterOf(points), frame + f);
  }
}

// A street: floor, two facades, clutter along them; the last tenth is still in the window.
TEST(VoxelMapBudget, ALeafOfAStreetTakesAtMost160Bytes) {
  VoxelMap map{VoxelMapOptions()};
  Builder street(&map, 1);
  constexpr int kSlices = 200;  // of 1.6 m
  for (int i = 0; i < kSlices; ++i) {
    const double x = 1.6 * i + 0.8;
    for (int k = -4; k < 4; ++k) {
      street.AddPatch({x, 1.6 * k + 0.8, 0.1}, Eigen::Vector3d::UnitZ(), 0.8, 0.005, 60);
    }
    for (const double y : {-7.1, 7.1}) {
      for (int k = 0; k < 4; ++k) {
        street.AddPatch({x, y, 1.6 * k + 0.8}, Eigen::Vector3d::UnitY(), 0.8, 0.01, 30);
      }
      street.AddClutter({x, 0.7 * y, 1.5}, 0.8, 20);
    }
    street.End(10 * i < 9 * kSlices);
  }
  ASSERT_GT(map.leaves(), 5000U);
  EXPECT_LT(static_cast<double>(map.bytes()) / static_cast<double>(map.leaves()), 160.0);
}

// Memory that one kind of node took is of no use to another.
TEST(VoxelMapBudget, IsKeptWhenTheSceneBecomesAnother) {
  VoxelMapOptions options;
  options.budget_mb = 4.0;
  MemoryVoxelStore store;
  VoxelMap map(options, &store);
  Builder scene(&map, 2);
  const auto drive = [&](double y, bool rough) {
    for (int frame = 0; frame < 150; ++frame) {
      for (int i = 0; i < 100; ++i) {
        const Eigen::Vector3d centre(1.6 * i + 0.8, y + 1.6 * frame + 0.8, 0.8);
        if (rough) {
          scene.AddClutter(centre, 0.7, 24);
        } else {
          scene.AddPatch(centre + Eigen::Vector3d::Constant(0.4), Eigen::Vector3d::UnitZ(), 0.3,
                         0.002, 10);
        }
      }
      scene.End(true);
      map.EvictToBudget();
      ASSERT_LE(static_cast<double>(map.bytes()), 4.0 * kMiB) << "frame " << frame;
      ASSERT_FALSE(map.over_budget());
    }
  };
  drive(0.0, false);    // one leaf and one plane a root
  drive(1000.0, true);  // eight leaves a root, no plane
  drive(2000.0, false);
  EXPECT_GT(store.records(), 20000U);
  // The budget is used: a good part of it holds what was seen last.
  EXPECT_GT(static_cast<double>(map.bytes()), 2.0 * kMiB);
  EXPECT_GT(map.roots(), 3000U);
}

TEST(VoxelMapBudget, RootsThatAreNotDividedWorkAlike) {
  VoxelMapOptions options;
  options.depth = 0;
  options.root_size_m = 0.8;
  VoxelMap map(options);
  Builder scene(&map, 3);
  scene.AddPatch({0.4, 0.4, 0.3}, Eigen::Vector3d::UnitZ(), 0.3, 0.002, 50);
  scene.AddClutter({2.0, 0.4, 0.4}, 0.35, 50);
  scene.End(false);
  EXPECT_EQ(map.roots(), 2U);
  EXPECT_EQ(map.leaves(), 2U);
  const VoxelMap::NodeId floor = map.FindSurface({0.4, 0.4, 0.4});
  ASSERT_NE(floor, VoxelMap::kNoNode);
  EXPECT_EQ(map.kind(floor), Surface::Kind::kPlane);
  EXPECT_NEAR(map.plane(floor).mean.z(), 0.3, 0.002);
  EXPECT_EQ(map.PlaneAbove(map.LeafAt({0.1, 0.1, 0.1})), floor);
  const VoxelMap::NodeId clutter = map.FindSurface({2.0, 0.4, 0.4});
  ASSERT_NE(clutter, VoxelMap::kNoNode);
  EXPECT_EQ(map.kind(clutter), Surface::Kind::kRough);
  EXPECT_EQ(map.Aggregate(clutter).count, 50.0);
}

TEST(VoxelMapBudget, EvictionKeepsTheBudgetAndReusesNodes) {
  Draws draws(5);
  VoxelMapOptions options;
  options.budget_mb = 8.0;
  MemoryVoxelStore store;
  VoxelMap map(options, &store);
  std::size_t surfels = 0, dropped = 0, added = 0, most_bytes = 0;
  for (int frame = 0; frame < 300; ++frame) {
    for (int i = 0; i < 200; ++i, ++added) AddPatch(i, frame, -frame, 2 * frame, &draws, &map);
    map.Refresh();
    dropped += map.EvictToBudget();
    most_bytes = std::max(most_bytes, map.bytes());
    ASSERT_LE(map.bytes(), 8U * 1048576U) << "after frame " << frame;
    // The newest patches are there.
    EXPECT_EQ(map.kind(map.FindSurface(options.root_size_m *
                                       Eigen::Vector3d(0.5, frame + 0.5, 0.5 - frame))),
              Surface::Kind::kPlane);
  }
  EXPECT_EQ(map.roots() + dropped, added);
  EXPECT_GT(dropped, added / 2);
  EXPECT_EQ(store.records(), dropped);
  // Everything is in memory or in the store.
  map.ForEachSurface(2, [&](const Surfel& s) {
    ++surfels;
    EXPECT_EQ(s.count, 20U);
    EXPECT_LT(s.eigenvalues(2), 1e-5F);
  });
  EXPECT_EQ(surfels, added);
  EXPECT_EQ(map.FindSurface({0.1, 0.1, 0.1}), VoxelMap::kNoNode);
  // Nodes of what has gone serve again, and are empty.
  const VoxelMap::NodeId fresh = map.LeafAt({-100.0, 0.0, 0.0});
  EXPECT_TRUE(map.Aggregate(fresh).Empty());
  EXPECT_EQ(map.kind(fresh), Surface::Kind::kEmpty);
}

TEST(VoxelMapBudget, EvictionSparesWhatIsHeld) {
  Draws draws(6);
  VoxelMapOptions options;
  options.budget_mb = 1.0;
  VoxelMap map(options);
  AddPatch(-50, 0, 0, 0, &draws, &map);
  const Eigen::Vector3d held = options.root_size_m * Eigen::Vector3d(-49.5, 0.5, 0.5);
  map.Hold(map.LeafAt(held));
  map.Hold(map.LeafAt(held));
  std::size_t dropped = 0;
  for (int frame = 0; frame < 50; ++frame) {
    if (frame == 25) map.Release(map.LeafAt(held));
    for (int i = 0; i < 200; ++i) AddPatch(i, frame, 0, 2 * frame, &draws, &map);
    map.Refresh();
    dropped += map.EvictToBudget();
    EXPECT_NE(map.FindSurface(held), VoxelMap::kNoNode);
  }
  EXPECT_GT(dropped, 5000U);
  map.Release(map.LeafAt(held));
  for (int frame = 50; frame < 80; ++frame) {
    for (int i = 0; i < 200; ++i) AddPatch(i, frame, 0, 2 * frame, &draws, &map);
    map.Refresh();
    map.EvictToBudget();
  }
  EXPECT_EQ(map.FindSurface(held), VoxelMap::kNoNode);
}

TEST(VoxelMapBudget, SaysThatItCannotKeepItsBudget) {
  Draws draws(9);
  VoxelMapOptions options;
  options.budget_mb = 1.0;
  VoxelMap map(options);
  const auto fill = [&](int frame, bool hold) {
    for (int i = 0; i < 200; ++i) {
      AddPatch(i, frame, 0, 2 * frame, &draws, &map);
      const Eigen::Vector3d centre =
          options.root_size_m * Eigen::Vector3d(i + 0.5, frame + 0.5, 0.5);
      if (hold) map.Hold(map.LeafAt(centre));
    }
    map.Refresh();
    map.EvictToBudget();
  };
  for (int frame = 0; frame < 20; ++frame) fill(frame, false);
  EXPECT_FALSE(map.over_budget());
  for (int frame = 20; frame < 50; ++frame) fill(frame, true);
  EXPECT_TRUE(map.over_budget());
  // What is held is all that is there.
  EXPECT_EQ(map.roots(), 6000U);
  EXPECT_LT(map.bytes(), 3U * 1048576U);
}

}  // namespace
}  // namespace lamina
