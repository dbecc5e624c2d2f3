#include <benchmark/benchmark.h>

#include "core/map/voxel_map.h"
#include "frontend/scan/scan_clusters.h"
#include "tests/benchmarks/world.h"

namespace lamina {
namespace {

void BM_BuildScanClusters(benchmark::State& state) {
  Draws draws(1);
  const std::vector<TimedPoint> points = Sweep(Neighbourhood(&draws), &draws);
  const double leaf_size_m = VoxelMapOptions().LeafSize();
  for (auto _ : state) benchmark::DoNotOptimize(BuildScanClusters(points, leaf_size_m));
  state.counters["points"] = static_cast<double>(points.size());
}
BENCHMARK(BM_BuildScanClusters)->Unit(benchmark::kMillisecond);

void BM_DeskewClusters(benchmark::State& state) {
  Draws draws(1);
  const std::vector<TimedCluster> clusters =
      BuildScanClusters(Sweep(Neighbourhood(&draws), &draws), VoxelMapOptions().LeafSize());
  const Vector6d twist = CarTwist();
  for (auto _ : state) benchmark::DoNotOptimize(DeskewClusters(clusters, twist));
  state.counters["clusters"] = static_cast<double>(clusters.size());
}
BENCHMARK(BM_DeskewClusters)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime()->UseRealTime();

}  // namespace
}  // namespace lamina
