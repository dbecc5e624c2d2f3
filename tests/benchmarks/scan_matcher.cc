#include <benchmark/benchmark.h>

#include "core/base/angle.h"
#include "frontend/matching/scan_matcher.h"
#include "tests/benchmarks/world.h"

namespace lamina {
namespace {

void BM_ScanMatcherMatch(benchmark::State& state) {
  Draws draws(1);
  const World world = Neighbourhood(&draws);
  VoxelMap map{VoxelMapOptions()};
  FillMap(world, 5, 1400, 0.01, &draws, &map);
  const std::vector<PointCluster> clusters =
      Untimed(BuildScanClusters(Sweep(world, &draws), map.options().LeafSize()));
  const ScanMatcher matcher{ScanMatcherOptions()};
  const PosePrediction start = {draws.Offset(0.3 * kDegree, 0.1), 1e-3 * Matrix6d::Identity()};
  MatchResult result;
  for (auto _ : state) result = matcher.Match(clusters, start, map);
  state.counters["clusters"] = static_cast<double>(clusters.size());
  state.counters["matched"] = result.matched;
  state.counters["iterations"] = result.iterations;
}
BENCHMARK(BM_ScanMatcherMatch)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

}  // namespace
}  // namespace lamina
