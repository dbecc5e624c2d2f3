#include "tools/watch/live/map_queries.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>
#include <thread>

#include "tests/support/memory_voxel_store.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

using Place = std::array<int, 3>;

// A map of ground along x, a plane in each root voxel.
class StreetMap {
 public:
  explicit StreetMap(double root_size_m, VoxelStore* store = nullptr, double budget_mb = 100.0)
      : map(Options(root_size_m, budget_mb), store) {}

  static VoxelMapOptions Options(double root_size_m, double budget_mb) {
    VoxelMapOptions options;
    options.root_size_m = root_size_m;
    options.depth = 0;
    options.budget_mb = budget_mb;
    return options;
  }

  void Pave(double from_m, double to_m, double width_m) {
    const double size = map.options().root_size_m;
    for (double x = from_m + 0.5 * size; x < to_m; x += size) {
      for (double y = 0.5 * size - width_m; y < width_m; y += size) AddPlane({x, y, 0.5 * size});
    }
    map.Refresh();
  }

  // What all pages hold together; each cell is on one of them.
  std::map<Place, std::size_t> Ask(MapQuery query, int* pages = nullptr,
                                   std::size_t* looked_at = nullptr) const {
    std::map<Place, std::size_t> cells;
    double last = 0.0;
    int count = 0;
    do {
      MapAnswer answer(map, 1, query);
      while (!answer.Continue()) {
      }
      if (looked_at != nullptr) *looked_at += answer.looked_at();
      const MapPage page = answer.TakePage();
      EXPECT_EQ(page.version, map.refreshes());
      for (const MapCell& cell : page.cells) {
        EXPECT_TRUE(cells.emplace(Place{cell.ix, cell.iy, cell.iz}, cell.surfels.size()).second);
        const Eigen::Vector3d low = page.cell_size_m * Eigen::Vector3d(cell.ix, cell.iy, cell.iz);
        const Eigen::Vector3d high = low + Eigen::Vector3d::Constant(page.cell_size_m);
        const double distance = (query.centre.cwiseMax(low).cwiseMin(high) - query.centre).norm();
        EXPECT_GE(distance, last - 1e-6) << "nearest first";
        EXPECT_LE(distance, query.radius_m);
        last = distance;
        for (const Surfel& s : cell.surfels) {
          EXPECT_TRUE((s.centre.array() >= low.array() - 1e-9).all() &&
                      (s.centre.array() <= high.array() + 1e-9).all());
        }
      }
      query.page = page.next;
      ++count;
    } while (query.page != 0);
    if (pages != nullptr) *pages = count;
    return cells;
  }

  static std::size_t Surfels(const std::map<Place, std::size_t>& cells) {
    std::size_t sum = 0;
    for (const auto& [place, surfels] : cells) sum += surfels;
    return sum;
  }

  VoxelMap map;

 private:
  void AddPlane(const Eigen::Vector3d& at) {
    const double reach = 0.4 * map.options().root_size_m;
    Points points;
    for (int i = 0; i < 12; ++i) {
      points.push_back(
          at + Eigen::Vector3d(draws_.Uniform(-reach, reach), draws_.Uniform(-reach, reach), 0.0));
    }
    map.AddWindow(map.LeafAt(at), ClusterOf(points), ++frame_);
  }

  Draws draws_{1};
  std::int64_t frame_ = 0;
};

MapQuery Ball(const Eigen::Vector3d& centre, double radius_m, std::int64_t newer_than = -1) {
  MapQuery query;
  query.centre = centre;
  query.radius_m = radius_m;
  query.newer_than = newer_than;
  return query;
}

TEST(MapAnswer, AllSurfelsOfTheSphereAreOnItsPages) {
  StreetMap street(0.5);
  street.map.TrackTiles();
  street.Pave(-150.0, 150.0, 4.0);
  std::size_t all = 0;
  street.map.ForEachSurface(1, [&](const Surfel&) { ++all; });
  EXPECT_EQ(all, 600U * 16U);
  int pages = 0;
  EXPECT_EQ(StreetMap::Surfels(street.Ask(Ball({0.1, 0.2, 0.3}, 200.0), &pages)), all);
  EXPECT_GT(pages, 0);
  // Before, 2142 pages for 200 m at this size, whatever the map.
  EXPECT_LT(pages, 6);
  const auto near = street.Ask(Ball({100.0, 0.2, 0.3}, 10.0));
  EXPECT_NEAR(static_cast<double>(StreetMap::Surfels(near)), 40.0 * 16.0, 4.0 * 16.0 * 4.0);
  EXPECT_TRUE(street.Ask(Ball({0.0, 100.0, 0.0}, 50.0)).empty());
  EXPECT_TRUE(street.Ask(Ball({1e9, 0.0, 0.0}, 50.0)).empty());
}

TEST(MapAnswer, CostsWhatItReturnsAndNotTheSphere) {
  StreetMap street(0.5);
  street.Pave(-20.0, 20.0, 2.0);
  street.map.TrackTiles();  // of what is there already
  std::size_t small = 0, large = 0, none = 0;
  const auto cells = street.Ask(Ball({0, 0, 0}, 30.0), nullptr, &small);
  EXPECT_EQ(StreetMap::Surfels(cells), 80U * 8U);
  EXPECT_EQ(street.Ask(Ball({0, 0, 0}, 200.0), nullptr, &large), cells);
  EXPECT_LE(large, 4 * cells.size() + 100);
  EXPECT_EQ(large, small);
  EXPECT_TRUE(street.Ask(Ball({0, 0, 0}, 200.0, street.map.refreshes()), nullptr, &none).empty());
  EXPECT_LT(none, 10U);
}

TEST(MapAnswer, ShowsWhatHasChanged) {
  MemoryVoxelStore store;
  StreetMap street(0.5, &store, 1.0);
  street.map.TrackTiles();
  street.Pave(0.0, 50.0, 4.0);
  const std::int64_t before = street.map.refreshes();
  EXPECT_TRUE(street.Ask(Ball({0, 0, 0}, 100.0, before)).empty());
  street.Pave(50.0, 60.0, 4.0);
  EXPECT_EQ(StreetMap::Surfels(street.Ask(Ball({0, 0, 0}, 100.0, before))), 20U * 16U);
  // What has left memory since then is news all the same, and is still there.
  street.Pave(1000.0, 1100.0, 4.0);
  ASSERT_GT(street.map.EvictToBudget(), 0U);
  EXPECT_EQ(StreetMap::Surfels(street.Ask(Ball({0, 0, 0}, 100.0, before))), 20U * 16U);
  EXPECT_EQ(StreetMap::Surfels(street.Ask(Ball({0, 0, 0}, 100.0))), 120U * 16U);
  // So are tiles that were in the store before they were asked for.
  street.map.TrackTiles();
  EXPECT_EQ(StreetMap::Surfels(street.Ask(Ball({0, 0, 0}, 100.0))), 120U * 16U);
}

TEST(MapAnswer, ASliceIsBounded) {
  StreetMap street(0.5);
  street.map.TrackTiles();
  street.Pave(-100.0, 100.0, 10.0);
  MapAnswer answer(street.map, 1, Ball({0, 0, 0}, 200.0));
  int slices = 1;
  while (!answer.Continue()) ++slices;
  const MapPage page = answer.TakePage();
  std::size_t surfels = 0;
  for (const MapCell& cell : page.cells) surfels += cell.surfels.size();
  EXPECT_GT(slices, 5);
  EXPECT_LT(surfels / static_cast<std::size_t>(slices), 2000U);
}

TEST(MapQueries, AreAnsweredSliceBySlice) {
  StreetMap street(0.5);
  street.map.TrackTiles();
  street.Pave(-100.0, 100.0, 10.0);
  std::atomic<int> woken{0};
  MapQueries queries([&] { ++woken; });
  EXPECT_FALSE(queries.AnswerSlice(street.map, 1));
  MapPage page;
  std::atomic<bool> answered{false};
  std::thread asker([&] {
    page = queries.Ask(Ball({0, 0, 0}, 5.0));
    const MapPage more = queries.Ask(Ball({0, 0, 0}, 150.0));
    EXPECT_GT(more.cells.size(), page.cells.size());
    answered = true;
  });
  while (!answered) {
    queries.AnswerSlice(street.map, 1);
    std::this_thread::yield();
  }
  asker.join();
  EXPECT_EQ(woken, 2);
  EXPECT_FALSE(page.cells.empty());
  EXPECT_EQ(page.next, 0U);
}

}  // namespace
}  // namespace lamina
