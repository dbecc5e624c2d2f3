#include "tools/simulate/study.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "backend/bundle/plane_geometry.h"
#include "core/base/angle.h"
#include "core/base/error.h"
#include "tools/synth/engine/random.h"

namespace lamina {
namespace {

constexpr double kAtOptimum = 1e-8, kSuccess = 1e-6;

// The least cost by which gaps are divided, see the header.
double CostFloor(const BundleProblem& problem, const std::vector<SE3>& poses) {
  constexpr double kDigits = std::numeric_limits<double>::epsilon() / kAtOptimum;
  const PoseMatrices matrices(poses);
  double sum = 0.0;
  for (const Plane& plane : problem.planes) {
    sum += 0.5 * plane.weight * AggregatePlane(problem, plane, matrices).scatter.Trace();
  }
  return kDigits * sum;
}

// What one formulation did, step by step.
struct Trace {
  struct Step {
    int iteration;
    double cost, ms;  // common cost
  };
  std::vector<Step> steps;
  BundleResult result;
};

Trace Solve(const BundleProblem& problem, const Formulation& formulation, int max_iterations) {
  Trace trace;
  double cost = EigenvalueCost(problem, problem.poses);
  trace.steps.push_back({0, cost, 0.0});
  trace.result = AdjustBundle(problem, TightOptions(max_iterations), formulation,
                              [&](const BundleStep& step, const std::vector<SE3>& poses) {
                                // A rejected step leaves the poses as they were.
                                if (step.accepted) cost = EigenvalueCost(problem, poses);
                                trace.steps.push_back({step.iteration, cost, step.solve_ms});
                              });
  return trace;
}

std::vector<TrialResult> Judge(const SimulatedScene& scene, const std::vector<Trace>& traces) {
  double best = std::numeric_limits<double>::infinity();
  std::vector<TrialResult> results(traces.size());
  for (std::size_t i = 0; i < traces.size(); ++i) {
    results[i].cost = EigenvalueCost(scene.problem, traces[i].result.poses);
    best = std::min(best, results[i].cost);
    for (const Trace::Step& step : traces[i].steps) best = std::min(best, step.cost);
  }
  const double scale = std::max(best, CostFloor(scene.problem, scene.truth));
  const double truth_cost = EigenvalueCost(scene.problem, scene.truth);
  for (std::size_t i = 0; i < traces.size(); ++i) {
    TrialResult& r = results[i];
    const BundleResult& solved = traces[i].result;
    const PoseErrors errors = ComparePoses(solved.poses, scene.truth);
    r.rot_error_deg = errors.rot_deg;
    r.trans_error_m = errors.trans_m;
    r.cost_gap = (r.cost - best) / scale;
    r.iterations = solved.iterations;
    r.ms = solved.solve_ms;
    r.status = solved.status;
    r.truth_cost = truth_cost;
    r.fits = solved.usable() && r.cost - truth_cost <= kSuccess * scale;
    r.success = r.fits && r.cost_gap < kSuccess;
    for (const Trace::Step& step : traces[i].steps) {
      if (!((step.cost - best) / scale <= kAtOptimum)) continue;
      r.iterations_to_optimum = step.iteration;
      r.ms_to_optimum = step.ms;
      break;
    }
  }
  return results;
}

bool AnyNeedsPoints(const std::vector<const Formulation*>& list) {
  return std::any_of(list.begin(), list.end(),
                     [](const Formulation* f) { return f->needs_points; });
}

bool Stopped(const std::atomic<bool>* stop) { return stop != nullptr && *stop; }

// False if it was stopped.
bool RunTrial(const StudyOptions& options, const SimulationOptions& simulation, std::uint64_t seed,
              const std::atomic<bool>* stop, std::vector<TrialResult>* results) {
  const SimulatedScene scene =
      MakeSimulatedScene(simulation, seed, AnyNeedsPoints(options.formulations));
  std::vector<Trace> traces;
  for (const Formulation* formulation : options.formulations) {
    if (Stopped(stop)) return false;
    traces.push_back(Solve(scene.problem, *formulation, options.max_iterations));
  }
  *results = Judge(scene, traces);
  return true;
}

// The first solve of a program pays for what later ones find in place: threads, memory, code.
void WarmUp(const StudyOptions& options) {
  SimulationOptions small;
  small.poses = small.planes = 10;
  const SimulatedScene scene = MakeSimulatedScene(small, options.seed, true);
  for (const Formulation* formulation : options.formulations) {
    Solve(scene.problem, *formulation, std::min(3, options.max_iterations));
  }
}

int WholeNumber(const char* sweep, double value) {
  constexpr double kLargest = 1e9;
  if (value == std::floor(value) && std::abs(value) <= kLargest) return static_cast<int>(value);
  throw OptionError(
      fmt::format("--values of the sweep {}: {} must be a whole number", sweep, value));
}

}  // namespace

const std::vector<std::string>& SweepNames() {
  static const std::vector<std::string> names = {"planes", "poses", "noise", "points", "start"};
  return names;
}

std::string SweepLabel(SweepKind kind) {
  static const std::vector<std::string> labels = {
      "planes", "poses", "noise (m)", "points of a plane in a pose", "start error (deg)"};
  return labels.at(static_cast<std::size_t>(kind));
}

std::vector<double> DefaultValues(SweepKind kind) {
  static const std::vector<std::vector<double>> values = {{10, 20, 50, 100, 200},
                                                          {5, 10, 20, 50, 100},
                                                          {0.001, 0.003, 0.01, 0.03, 0.1},
                                                          {10, 40, 160, 640},
                                                          {2, 5, 10, 20}};
  return values.at(static_cast<std::size_t>(kind));
}

SimulationOptions AtValue(SimulationOptions base, SweepKind kind, double value) {
  const char* name = SweepNames().at(static_cast<std::size_t>(kind)).c_str();
  switch (kind) {
    case SweepKind::kPlanes:
      base.planes = WholeNumber(name, value);
      break;
    case SweepKind::kPoses:
      base.poses = WholeNumber(name, value);
      break;
    case SweepKind::kNoise:
      base.noise_m = value;
      break;
    case SweepKind::kPoints:
      base.points = WholeNumber(name, value);
      break;
    case SweepKind::kStart:
      base.start_deg = value;
      base.start_m = kStartMetresPerDegree * value;
      break;
  }
  try {
    base.Check();
  } catch (const OptionError& error) {
    throw OptionError(fmt::format("sweep {} at {}: {}", name, value, error.what()));
  }
  return base;
}

void StudyOptions::Check() const {
  const auto require = [](bool good, const std::string& message) {
    if (!good) throw OptionError(message);
  };
  base.Check();
  constexpr int kMost = 1000000;
  require(trials >= 1 && trials <= kMost,
          fmt::format("--trials = {}: must be in [1, {}]", trials, kMost));
  require(max_iterations >= 1 && max_iterations <= 100000,
          fmt::format("--max-iterations = {}: must be in [1, 100000]", max_iterations));
  require(seed <= kLargestSeed, fmt::format("--seed = {}: must be in [0, {}]", seed, kLargestSeed));
  require(!formulations.empty(), "--formulations: at least one is needed");
  for (const Sweep& sweep : sweeps) {
    require(!sweep.values.empty(), "--values: at least one is needed");
    for (const double value : sweep.values) AtValue(base, sweep.kind, value);
  }
}

std::size_t StudyOptions::Scenes() const {
  std::size_t values = 0;
  for (const Sweep& sweep : sweeps) values += sweep.values.size();
  return values * static_cast<std::size_t>(trials);
}

std::uint64_t SceneSeed(std::uint64_t study_seed, std::size_t value_index, int trial) {
  if (value_index == 0 && trial == 0) return study_seed;
  return synth::HashOf({static_cast<std::int64_t>(study_seed),
                        static_cast<std::int64_t>(value_index), trial}) &
         kLargestSeed;
}

void RunStudy(const StudyOptions& options, const TrialSink& sink, const std::atomic<bool>* stop) {
  options.Check();
  WarmUp(options);
  for (const Sweep& sweep : options.sweeps) {
    for (std::size_t v = 0; v < sweep.values.size(); ++v) {
      const SimulationOptions simulation = AtValue(options.base, sweep.kind, sweep.values[v]);
      for (int trial = 0; trial < options.trials; ++trial) {
        const std::uint64_t seed = SceneSeed(options.seed, v, trial);
        std::vector<TrialResult> results;
        if (!RunTrial(options, simulation, seed, stop, &results)) return;
        for (std::size_t i = 0; i < results.size(); ++i) {
          results[i].formulation = options.formulations[i];
          results[i].sweep = sweep.kind;
          results[i].value = sweep.values[v];
          results[i].trial = trial;
          results[i].seed = seed;
        }
        sink(results);
      }
    }
  }
}

PoseErrors ComparePoses(const std::vector<SE3>& estimate, const std::vector<SE3>& truth) {
  double rotation = 0.0, translation = 0.0;
  for (std::size_t k = 1; k < truth.size(); ++k) {
    const double angle = RotationAngle(estimate[k], truth[k]);
    rotation += angle * angle;
    translation += (estimate[k].t - truth[k].t).squaredNorm();
  }
  const double count = static_cast<double>(truth.size() - 1);
  return {Degrees(std::sqrt(rotation / count)), std::sqrt(translation / count)};
}

BundleAdjusterOptions TightOptions(int max_iterations) {
  BundleAdjusterOptions options;
  options.max_iterations = max_iterations;
  options.min_cost_change = 1e-12;
  options.min_planes = 3;
  return options;
}

const char* StatusName(BundleResult::Status status) {
  switch (status) {
    case BundleResult::Status::kConverged:
      return "converged";
    case BundleResult::Status::kIterationLimit:
      return "iteration_limit";
    case BundleResult::Status::kTooFewPlanes:
      return "too_few_planes";
    case BundleResult::Status::kFailed:
      break;
  }
  return "failed";
}

}  // namespace lamina
