#include <benchmark/benchmark.h>

#include "core/map/voxel_map.h"
#include "tests/benchmarks/world.h"

namespace lamina {
namespace {

// A scan joins a map that knows the place: nodes are there, every surface it meets is refreshed.
void BM_AddWindowAndRefresh(benchmark::State& state) {
  Draws draws(1);
  const World world = Neighbourhood(&draws);
  VoxelMap map{VoxelMapOptions()};
  FillMap(world, 3, 1400, 0.01, &draws, &map);
  const std::vector<PointCluster> clusters =
      Untimed(BuildScanClusters(Sweep(world, &draws), map.options().LeafSize()));
  std::int64_t frame = 3;
  for (auto _ : state) {
    for (const PointCluster& c : clusters) map.AddWindow(map.LeafAt(c.mean), c, frame);
    map.Refresh();
    ++frame;
  }
  state.counters["clusters"] = static_cast<double>(clusters.size());
}
BENCHMARK(BM_AddWindowAndRefresh)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

}  // namespace
}  // namespace lamina
