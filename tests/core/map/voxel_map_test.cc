#include "core/map/voxel_map.h"

#include <gtest/gtest.h>

#include <set>

#include "tests/core/map/voxel_map_fixture.h"
#include "tests/support/sanitizers.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

using Kind = Surface::Kind;
using NodeId = VoxelMap::NodeId;

constexpr int kManyPerSide = kSanitized ? 60 : 127;  // 216 000 or 2 048 383 voxels

// Nothing is a plane.
VoxelMapOptions NoPlanes() {
  VoxelMapOptions options;
  options.max_flatness = 1e-6;
  options.max_fixed_weight = 1e9;
  return options;
}

void ExpectSame(const PointCluster& a, const PointCluster& b) {
  EXPECT_NEAR(a.count, b.count, 1e-9);
  // Fixed parts are kept in single precision, relative to their voxel.
  EXPECT_LT(MeanGap(a, b), 2e-7);
  EXPECT_LT(ScatterGap(a, b), 2e-6);
}

TEST(VoxelMap, PlacesOfManyAreThoseOfEach) {
  constexpr std::size_t kStride = 2;
  Draws draws(8);
  for (int depth = 0; depth <= 4; ++depth) {
    VoxelMapOptions options;
    options.depth = depth;
    const VoxelMap map(options);
    std::vector<PointCluster> clusters;
    for (int i = 0; i < 203; ++i) {
      PointCluster cluster;
      // On borders of leaves, anywhere, and beyond what the map can hold.
      const double m = i % 3 == 0 ? options.LeafSize() : i % 3 == 1 ? 7.3 : 3e5;
      cluster.AddPoint(m * draws.Direction());
      if (i % 3 == 0) cluster.mean = m * (10.0 * cluster.mean / m).array().round().matrix();
      clusters.push_back(cluster);
    }
    for (const SE3& T : {SE3(), SE3(ExpSO3(2.0 * draws.Direction()), 50.0 * draws.Direction())}) {
      const std::size_t count = (clusters.size() + kStride - 1) / kStride;
      std::vector<LeafPlace> places(count);
      map.PlacesOf(clusters.data(), kStride, count, T.R(), T.t, places.data());
      for (std::size_t i = 0; i < count; ++i) {
        const Eigen::Vector3d p = T.R() * clusters[kStride * i].mean + T.t;
        EXPECT_TRUE(places[i] == (map.CanHold(p) ? map.PlaceOf(p) : LeafPlace())) << i;
      }
    }
  }
}

TEST(VoxelMap, TheCoarsestPlanarNodeIsFound) {
  Draws draws(1);
  VoxelMapOptions options;
  options.depth = 2;
  VoxelMap map(options);
  // One floor through a whole root.
  Points floor;
  for (int i = 0; i < 600; ++i) {
    floor.emplace_back(draws.Uniform(0.0, 1.6), draws.Uniform(0.0, 1.6), 0.3);
  }
  AddPoints(floor, 0, &map);
  map.Refresh();
  std::set<NodeId> found;
  for (const Eigen::Vector3d& p : floor) {
    found.insert(map.FindSurface(p));
    EXPECT_EQ(map.PlaneAbove(map.LeafAt(p)), map.FindSurface(p));
  }
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(map.kind(*found.begin()), Kind::kPlane);
  EXPECT_NEAR(std::abs(map.plane(*found.begin()).normal.z()), 1.0, 1e-6);
  ExpectSame(map.Aggregate(*found.begin()), ClusterOf(floor));
  // A wall above it breaks the root into smaller planes.
  Points wall;
  for (int i = 0; i < 600; ++i) {
    wall.emplace_back(1.3, draws.Uniform(0.0, 1.6), draws.Uniform(0.8, 1.6));
  }
  AddPoints(wall, 1, &map);
  map.Refresh();
  const NodeId low = map.FindSurface({0.1, 0.1, 0.3});
  const NodeId high = map.FindSurface({1.3, 0.1, 1.0});
  EXPECT_NE(low, high);
  EXPECT_EQ(map.kind(low), Kind::kPlane);
  EXPECT_NEAR(std::abs(map.plane(low).normal.z()), 1.0, 1e-6);
  EXPECT_NEAR(std::abs(map.plane(high).normal.x()), 1.0, 1e-6);
  // Octants of 0.8 m, not leaves of 0.4 m: the coarsest below the root.
  EXPECT_EQ(map.FindSurface({1.3, 0.7, 1.5}), high);
  EXPECT_EQ(map.FindSurface({0.1, 0.1, 1.5}), VoxelMap::kNoNode);
  EXPECT_EQ(map.FindSurface({5.0, 0.1, 1.5}), VoxelMap::kNoNode);
  int surfaces = 0;
  map.ForEachSurface(1, [&](const Surfel&) { ++surfaces; });
  EXPECT_EQ(surfaces, 6);  // four octants of floor, two of wall
}

TEST(VoxelMap, APlaneThatTooFewFramesSawHidesWhatLiesBelow) {
  Draws draws(8);
  VoxelMap map{VoxelMapOptions()};
  const auto add_floor = [&](int points, double edge, std::int64_t frame) {
    Points floor;
    for (int i = 0; i < points; ++i) {
      floor.emplace_back(draws.Uniform(0.0, edge), draws.Uniform(0.0, edge), 0.3);
    }
    AddPoints(floor, frame, &map);
    map.Refresh();
  };
  const auto surfaces = [&](int min_frames) {
    int count = 0;
    map.ForEachSurface(min_frames, [&](const Surfel&) { ++count; });
    return count;
  };
  // Clutter above keeps a little floor from being one plane with the root: an octant is the plane.
  AddPoints(draws.Cloud(4, {0.4, 0.4, 1.2}, 0.1), 0, &map);
  add_floor(20, 0.8, 0);
  const NodeId octant = map.FindSurface({0.4, 0.4, 0.3});
  EXPECT_EQ(surfaces(1), 1);
  EXPECT_EQ(map.PlaneAbove(octant), octant);
  // Much floor makes the root one: what the octant looked like is not kept up to date from here on.
  add_floor(600, 1.6, 1);
  EXPECT_NE(map.FindSurface({0.4, 0.4, 0.3}), octant);
  EXPECT_EQ(map.PlaneAbove(octant), map.FindSurface({0.4, 0.4, 0.3}));
  EXPECT_EQ(surfaces(2), 1);
  EXPECT_EQ(surfaces(3), 0);
}

// Whatever decides without the eigenvalues decides as they do.
TEST(VoxelMap, AClusterIsAPlaneByItsEigenvaluesAlone) {
  VoxelMapOptions options;
  Draws draws(17);
  int planes = 0;
  constexpr int kClusters = 20000;
  for (int i = 0; i < kClusters; ++i) {
    // Down to what no plane is thin enough for, and close to every limit.
    options.min_breadth = i % 2 == 0 ? 0.02 : 0.0;
    const VoxelMap map(options);
    const double l1 = std::pow(10.0, draws.Uniform(-6.0, 2.0));
    const double l2 =
        l1 * std::pow(10.0, i % 3 == 0 ? draws.Uniform(-12.0, 0.0) : draws.Uniform(-2.0, 0.0));
    double l3 = l2 * std::pow(10.0, draws.Uniform(-3.0, 0.0));
    if (i % 5 == 0) l3 = std::min(l2, options.max_flatness * l2 * draws.Uniform(0.999, 1.001));
    if (i % 7 == 0) l3 = std::min(l2, draws.Uniform(0.00999, 0.01001));
    const Eigen::Matrix3d R = ExpSO3(3.0 * draws.Direction()).toRotationMatrix();
    PointCluster cluster;
    cluster.count = 100.0;
    cluster.scatter = Symmetric3::FromDense(
        cluster.count * (R * Eigen::Vector3d(l1, l2, l3).asDiagonal() * R.transpose()));
    const Eigen::Vector3d l = cluster.EigenPairs().l;
    constexpr double kLeastBreadth2 = 1e-6;  // m^2
    const bool plane = l(2) <= options.max_thickness_m * options.max_thickness_m &&
                       l(1) > kLeastBreadth2 && l(2) <= options.max_flatness * l(1) &&
                       l(1) >= options.min_breadth * l(0);
    ASSERT_EQ(map.SurfaceOf(cluster, 1).kind, plane ? Kind::kPlane : Kind::kRough) << l.transpose();
    planes += plane ? 1 : 0;
  }
  EXPECT_GT(planes, kClusters / 10);
  EXPECT_LT(planes, kClusters / 2);
}

TEST(VoxelMap, AParentIsTheSumOfItsChildren) {
  Draws draws(2);
  for (int i = 0; i < 50; ++i) {
    VoxelMap map(OnlyPlanes());
    const double half = 0.5 * map.options().root_size_m;
    const Eigen::Vector3d centre = 2.0 * half * Eigen::Vector3d(-2.5, i + 0.5, 7000.5);
    const Points points = draws.Cloud(300, centre, half);
    AddPoints(points, 0, &map);
    map.Refresh();
    EXPECT_EQ(map.roots(), 1U);
    EXPECT_GT(map.nodes(), 50U);
    const NodeId root = map.FindSurface(points[0]);
    ExpectSame(map.Aggregate(root), ClusterOf(points));
    const Eigen3 eigen = ClusterOf(points).EigenPairs();
    EXPECT_NEAR(map.plane(root).flatness, eigen.l(2) / eigen.l(1), 1e-5);
  }
}

// What a frame put into one leaf.
struct Entry {
  Eigen::Vector3d place;
  PointCluster cluster;
  std::int64_t frame;
};

TEST(VoxelMap, BookkeepingEqualsRebuildingFromScratch) {
  Draws draws(3);
  for (int run = 0; run < 20; ++run) {
    VoxelMap map(NoPlanes());
    VoxelMap rebuilt(NoPlanes());
    std::vector<Entry> entries;
    const std::int64_t frames = 8;
    const std::int64_t fixed = draws.Integer(0, 8);
    for (std::int64_t f = 0; f < frames; ++f) {
      for (int k = 0; k < 40; ++k) {
        const Eigen::Vector3d place = draws.InCube(2.0);
        entries.push_back({place, ClusterOf(draws.Cloud(5, place, 0.3)), f});
        map.AddWindow(map.LeafAt(place), entries.back().cluster, f);
      }
    }
    std::vector<NodeId> leaves;
    std::vector<PointCluster> before, after;
    for (Entry& e : entries) {
      const PointCluster moved = e.cluster.Moved(draws.Offset(0.05, 0.1));
      leaves.push_back(map.LeafAt(e.place));
      before.push_back(e.cluster);
      after.push_back(moved);
      e.cluster = moved;
    }
    map.ReplaceWindow(leaves, before, after);
    for (const Entry& e : entries) {
      if (e.frame < fixed) map.FixWindow(map.LeafAt(e.place), e.cluster, 1.0, e.frame);
      rebuilt.AddWindow(rebuilt.LeafAt(e.place), e.cluster, e.frame);
    }
    for (const Entry& e : entries) {
      if (e.frame < fixed) rebuilt.FixWindow(rebuilt.LeafAt(e.place), e.cluster, 1.0, e.frame);
    }
    map.Refresh();
    rebuilt.Refresh();
    for (const Entry& e : entries) {
      const NodeId leaf = map.LeafAt(e.place);
      PointCluster all, gone;
      std::set<std::int64_t> seen_by;
      for (const Entry& other : entries) {
        if (map.LeafAt(other.place) != leaf) continue;
        all += other.cluster;
        if (other.frame < fixed) gone += other.cluster;
        seen_by.insert(other.frame);
      }
      ExpectSame(map.Aggregate(leaf), all);
      ExpectSame(map.FixedAggregate(leaf), gone);
      ExpectSame(rebuilt.Aggregate(rebuilt.LeafAt(e.place)), all);
      EXPECT_EQ(map.frames(leaf), seen_by.size());
      EXPECT_EQ(rebuilt.frames(rebuilt.LeafAt(e.place)), seen_by.size());
    }
  }
}

TEST(VoxelMap, FixedPointsAreOfFramesBeforeOrSince) {
  Draws draws(6);
  VoxelMap map(NoPlanes());
  const Eigen::Vector3d at(0.1, 0.1, 0.1);
  const NodeId leaf = map.LeafAt(at);
  EXPECT_EQ(map.FixedSince(leaf, 0, 10.0), 0.0);
  for (std::int64_t f = 0; f < 5; ++f) {
    const PointCluster cluster = ClusterOf(draws.Cloud(10, at, 0.05));
    map.AddWindow(leaf, cluster, f);
    if (f < 4) map.FixWindow(leaf, cluster, 1.0, f);
  }
  for (std::int64_t f = 0; f <= 5; ++f)
    EXPECT_NEAR(map.FixedSince(leaf, f, 10.0),
                10.0 * static_cast<double>(std::max<std::int64_t>(0, 4 - f)), 1e-6);
  // What was put together elsewhere is as new as its last frame.
  const NodeId other = map.LeafAt(10.0 * at);
  map.AddFixed(other, ClusterOf(draws.Cloud(9, at, 0.05)), 3, 7);
  EXPECT_EQ(map.FixedSince(other, 8, 3.0), 0.0);
  EXPECT_NEAR(map.FixedSince(other, 6, 3.0), 6.0, 1e-6);
  EXPECT_NEAR(map.FixedSince(other, 1, 3.0), 9.0, 1e-6);
}

TEST(VoxelMap, FixedClustersAreCapped) {
  Draws draws(4);
  VoxelMapOptions options = NoPlanes();
  options.max_fixed_weight = 12.0;
  VoxelMap map(options);
  const NodeId leaf = map.LeafAt({0.1, 0.1, 0.1});
  PointCluster last;
  for (std::int64_t f = 0; f < 50; ++f) {
    // The place moves: what is new overrules what is old.
    last = ClusterOf(draws.Cloud(5, {f < 25 ? 0.1 : 0.5, 0.1, 0.1}, 0.05));
    map.AddWindow(leaf, last, f);
    map.FixWindow(leaf, last, 1.0, f);
    EXPECT_LE(map.FixedAggregate(leaf).count, 12.0 + 1e-9);
  }
  EXPECT_NEAR(map.FixedAggregate(leaf).count, 12.0, 1e-9);
  EXPECT_NEAR(map.FixedAggregate(leaf).mean.x(), 0.5, 0.03);
}

TEST(VoxelMap, HoldsMillionsOfVoxels) {
  VoxelMapOptions options;
  options.depth = 0;
  options.root_size_m = 1.0;
  VoxelMap map(options);
  const auto each = [](const auto& visit) {
    for (int x = 0; x < kManyPerSide; ++x) {
      for (int y = 0; y < kManyPerSide; ++y) {
        for (int z = 0; z < kManyPerSide; ++z) {
          visit(Eigen::Vector3d(x - 50.5, y - 50.5, z - 50.5));
        }
      }
    }
  };
  PointCluster point;
  point.count = 1.0;
  each([&](const Eigen::Vector3d& p) {
    point.mean = p;
    map.AddWindow(map.LeafAt(p), point, 0);
  });
  const std::size_t count = static_cast<std::size_t>(kManyPerSide) * kManyPerSide * kManyPerSide;
  EXPECT_EQ(map.roots(), count);
  EXPECT_EQ(map.leaves(), count);
  EXPECT_LT(map.bytes() / count, 350U);
  std::size_t wrong = 0;
  each([&](const Eigen::Vector3d& p) {
    const NodeId id = map.FindSurface(p);
    if (id == VoxelMap::kNoNode || map.Aggregate(id).mean != p) ++wrong;
  });
  EXPECT_EQ(wrong, 0U);
}

// The surfaces of a map refreshed by so many threads.
std::vector<Surfel> RefreshedWith(std::size_t threads) {
  const ThreadLimit limit(threads);
  Draws draws(7);
  VoxelMap map{VoxelMapOptions()};
  std::vector<Surfel> surfels;
  for (std::int64_t frame = 0; frame < 3; ++frame) {
    for (int i = 0; i < 3000; ++i) {
      const Patch patch(draws.InCube(20.0), draws.Direction());
      for (int k = 0; k < 12; ++k) {
        const Eigen::Vector3d p = patch.Point(0.4, 0.01, &draws);
        map.AddWindow(map.LeafAt(p), ClusterOf({p}), frame);
      }
    }
    map.Refresh();
    map.ForEachSurface(1, [&](const Surfel& s) { surfels.push_back(s); });
  }
  return surfels;
}

TEST(VoxelMap, RefreshHasTheSameBitsAtAnyNumberOfThreads) {
  const std::vector<Surfel> one = RefreshedWith(1);
  const std::vector<Surfel> two = RefreshedWith(2);
  ASSERT_GT(one.size(), 1000U);
  ASSERT_EQ(one.size(), two.size());
  std::size_t different = 0;
  for (std::size_t i = 0; i < one.size(); ++i) {
    if (one[i].centre != two[i].centre || one[i].normal != two[i].normal ||
        one[i].eigenvalues != two[i].eigenvalues || one[i].count != two[i].count) {
      ++different;
    }
  }
  EXPECT_EQ(different, 0U);
}

TEST(VoxelMap, SaysWhatItCannotHold) {
  const VoxelMap map{VoxelMapOptions()};
  EXPECT_TRUE(map.CanHold({4e5, -4e5, 1e4}));
  EXPECT_FALSE(map.CanHold({1e9, 0.0, 0.0}));
  EXPECT_FALSE(map.CanHold({0.0, 0.0, 1e5}));
  EXPECT_FALSE(map.CanHold({0.0, 0.0, std::nan("")}));
}

}  // namespace
}  // namespace lamina
