#include <benchmark/benchmark.h>

#include "backend/condensed_cost.h"
#include "tests/random_bundles.h"

namespace lamina {
namespace {

// A window of 15 frames with as many planes as a street has.
void BM_CondensedCostLinearise(benchmark::State& state) {
  BundleSceneOptions options;
  options.poses = 15;
  options.planes = 3000;
  options.points = 10;
  options.seen_share = 0.4;
  options.sigma_m = 0.01;
  Draws draws(1);
  const BundleScene scene = MakeBundleScene(options, &draws);
  const CondensedCost cost(scene.problem);
  Eigen::VectorXd gradient;
  Eigen::MatrixXd hessian;
  for (auto _ : state) {
    benchmark::DoNotOptimize(cost.Linearise(scene.problem.poses, &gradient, &hessian));
  }
  state.counters["planes"] = static_cast<double>(scene.problem.planes.size());
  state.counters["observations"] = static_cast<double>(scene.problem.observations.size());
}
BENCHMARK(BM_CondensedCostLinearise)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

}  // namespace
}  // namespace lamina
