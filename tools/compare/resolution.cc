// The resolution study of the paper, figure 4: error and time against the resolution of the input.
//
// The cost of a point cluster does not depend on its number of points, that of BALM's does. To show
// that and nothing else, every resolution must pose the same problem: leaves of the map narrower
// than the distance of the coarsest points would hold planes in the fine inputs alone. So the map
// is halved less often here where need be.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>

#include "core/base/error.h"
#include "tools/cli/common.h"
#include "tools/compare/jobs/jobs.h"
#include "tools/compare/sequence.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

struct Curve {
  const char* title;
  const char* method;
  int max_iterations;
};
constexpr int kToConvergence = 400;
constexpr Curve kCurves[] = {{"BALM (evm1)", "evm1", kToConvergence},
                             {"huang, 20 iterations", "huang", 20},
                             {"huang, to convergence", "huang", kToConvergence},
                             {"condensed, 20 iterations", "condensed", 20},
                             {"condensed, to convergence", "condensed", kToConvergence}};

CompareConfig WithLeavesAbove(double distance_m, CompareConfig config) {
  while (config.lamina.map.depth > 0 && config.lamina.map.LeafSize() < distance_m)
    --config.lamina.map.depth;
  return config;
}

std::optional<ResolutionPoint> PointOf(const Curve& curve, const CompareTask& task,
                                       const std::vector<SE3>& truth) {
  const auto row = ReadRow(RowPath(task.row_folder, curve.method), task.fingerprint);
  if (!row || !row->good) return std::nullopt;
  return ResolutionPoint{
      curve.title,        task.resolution_m, 100.0 * CompareAll(row->poses, truth).ape_rmse_m,
      1e3 * row->solve_s, row->planes,       row->iterations};
}

}  // namespace

std::vector<ResolutionPoint> Comparison::StudyResolution(const CompareSequence& sequence,
                                                         const std::vector<double>& resolutions_m) {
  std::vector<SE3> initial;
  std::string reason;
  if (!InitialPoses(sequence, &initial, &reason)) throw InputError(reason);
  const double coarsest_m = *std::max_element(resolutions_m.begin(), resolutions_m.end());
  const std::string config = ToYaml(WithLeavesAbove(coarsest_m, settings_.config));
  const fs::path rows = RowFolder(sequence.name);
  CompareTask common;
  common.sequence = sequence.name;
  common.fingerprint = FingerprintOf(sequence, config);
  common.initial = WriteInitialPoses(sequence, initial);
  common.config = (rows / "resolution_config.yaml").string();
  common.time_limit_s = settings_.time_limit_s;
  WriteTextFile(common.config, config);
  std::vector<CompareTask> tasks;
  for (const Curve& curve : kCurves) {
    for (const double resolution : resolutions_m) {
      CompareTask task = common;
      task.methods = {curve.method};
      task.resolution_m = resolution;
      task.max_iterations = curve.max_iterations;
      const std::string name =
          fmt::format("resolution_{:g}_{}_{}", resolution, curve.method, curve.max_iterations);
      task.row_folder = (rows / name).string();
      tasks.push_back(std::move(task));
    }
  }
  RunStudy(sequence, tasks);
  std::vector<ResolutionPoint> points;
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    const Curve& curve = kCurves[i / resolutions_m.size()];
    if (auto point = PointOf(curve, tasks[i], sequence.truth)) points.push_back(std::move(*point));
  }
  return points;
}

void Comparison::RunStudy(const CompareSequence& sequence,
                          const std::vector<CompareTask>& tasks) const {
  std::vector<CompareTask> missing;
  for (const CompareTask& task : tasks) {
    MakeDirectory(task.row_folder);
    if (!ReadRow(RowPath(task.row_folder, task.methods[0]), task.fingerprint)) {
      missing.push_back(task);
    }
  }
  if (missing.empty()) return;
  const CompareFiles files = sequence.open();
  for (CompareTask& task : missing) task.scans = files.scans;
  // One at a time: it is times that are compared.
  const bool done = RunTasks(missing, {"of the resolution study", "in the resolution study"},
                             sequence.truth.size(), 1);
  if (sequence.close) sequence.close();
  if (!done) throw InterruptedError("in the resolution study; finished runs are kept");
}

}  // namespace lamina
