#include <benchmark/benchmark.h>

#include "backend/bundle/condensed_cost.h"
#include "tests/support/scenes/random_bundles.h"

namespace lamina {
namespace {

BundleScene Scene(int poses, int planes, double seen_share, int points) {
  BundleSceneOptions options;
  options.poses = poses;
  options.planes = planes;
  options.points = points;
  options.seen_share = seen_share;
  options.sigma_m = 0.01;
  Draws draws(1);
  return MakeBundleScene(options, &draws);
}

void Count(const BundleScene& scene, benchmark::State* state) {
  state->counters["planes"] = static_cast<double>(scene.problem.planes.size());
  state->counters["observations"] = static_cast<double>(scene.problem.observations.size());
}

// One evaluation with derivatives, multiplied out: a window of 15 frames with as many planes as a
// street has.
void BM_CondensedCostWindow(benchmark::State& state) {
  const BundleScene scene = Scene(15, 3000, 0.4, 10);
  CondensedCost cost(scene.problem);
  const BundleIndex index(scene.problem);
  ReducedSystem system;
  Eigen::MatrixXd H;
  for (auto _ : state) {
    cost.Linearise(scene.problem.poses, &system);
    system.Assemble(scene.problem, index, &H);
    benchmark::DoNotOptimize(H.data());
  }
  Count(scene, &state);
}
BENCHMARK(BM_CondensedCostWindow)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

// How an evaluation grows with the observations of a plane (first argument) and with its points
// (second): linear in the observations for the pass, with their square for the product, and not at
// all with points.
void BM_CondensedCostPass(benchmark::State& state) {
  const BundleScene scene =
      Scene(static_cast<int>(state.range(0)), 200, 1.0, static_cast<int>(state.range(1)));
  CondensedCost cost(scene.problem);
  ReducedSystem system;
  for (auto _ : state) cost.Linearise(scene.problem.poses, &system);
  Count(scene, &state);
}
void BM_CondensedCostProduct(benchmark::State& state) {
  const BundleScene scene =
      Scene(static_cast<int>(state.range(0)), 200, 1.0, static_cast<int>(state.range(1)));
  CondensedCost cost(scene.problem);
  const BundleIndex index(scene.problem);
  ReducedSystem system;
  cost.Linearise(scene.problem.poses, &system);
  Eigen::MatrixXd H;
  for (auto _ : state) {
    system.Assemble(scene.problem, index, &H);
    benchmark::DoNotOptimize(H.data());
  }
  Count(scene, &state);
}
#define LAMINA_GROWTH(name)           \
  BENCHMARK(name)                     \
      ->Args({10, 10})                \
      ->Args({20, 10})                \
      ->Args({40, 10})                \
      ->Args({80, 10})                \
      ->Args({20, 100})               \
      ->Args({20, 1000})              \
      ->Unit(benchmark::kMillisecond) \
      ->MeasureProcessCPUTime()       \
      ->UseRealTime()
LAMINA_GROWTH(BM_CondensedCostPass);
LAMINA_GROWTH(BM_CondensedCostProduct);
#undef LAMINA_GROWTH

}  // namespace
}  // namespace lamina
