#include "tools/simulate/nees.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/math/distributions/chi_squared.hpp>
#include <cmath>

#include "core/base/error.h"
#include "core/base/median.h"
#include "tools/simulate/report.h"

namespace lamina {
namespace {

constexpr double kShare = 0.95;

NeesSummary SummaryOf(const std::vector<const NeesTrial*>& group) {
  NeesSummary s;
  s.sweep = group.front()->sweep;
  s.value = group.front()->value;
  s.degrees_of_freedom = group.front()->degrees_of_freedom;
  s.runs = static_cast<int>(group.size());
  s.mean_interval = MeanNeesInterval(s.degrees_of_freedom, s.runs, kShare);
  const Interval single = MeanNeesInterval(s.degrees_of_freedom, 1, kShare);
  std::vector<double> values;
  double sum = 0.0;
  int inside = 0;
  for (const NeesTrial* t : group) {
    values.push_back(t->nees);
    sum += t->nees;
    inside += single.low <= t->nees && t->nees <= single.high ? 1 : 0;
  }
  s.mean = sum / s.runs;
  s.largest = *std::max_element(values.begin(), values.end());
  s.median = Median(std::move(values));
  s.share_in_95 = static_cast<double>(inside) / s.runs;
  return s;
}

}  // namespace

void MeasureNees(const SimulatedScene& scene, int max_iterations, NeesTrial* trial) {
  const BundleProblem& problem = scene.problem;
  const BundleResult solved = AdjustBundle(problem, TightOptions(max_iterations));
  const std::unique_ptr<BundleCost> cost = CondensedFormulation().make_cost(problem);
  ReducedSystem system;
  cost->Linearise(solved.poses, &system);
  Eigen::MatrixXd H;
  system.Assemble(problem, BundleIndex(problem), &H);
  const Eigen::Index size = H.rows() - 6;
  Eigen::VectorXd error(size);
  for (Eigen::Index i = 0; i < size; i += 6) {
    const auto k = static_cast<std::size_t>(i / 6 + 1);
    error.segment<6>(i) = LocalDelta(solved.poses[k], scene.truth[k]);
  }
  trial->degrees_of_freedom = static_cast<int>(size);
  trial->nees = error.dot(H.bottomRightCorner(size, size) * error);
  trial->errors = ComparePoses(solved.poses, scene.truth);
  trial->status = solved.status;
}

void CheckNeesStudy(const StudyOptions& options) {
  for (const Sweep& sweep : options.sweeps) {
    for (const double value : sweep.values) {
      if (AtValue(options.base, sweep.kind, value).noise_m > 0.0) continue;
      throw OptionError("--nees with noise 0: the noise must be above 0, else no covariance is");
    }
  }
}

void RunNeesStudy(const StudyOptions& options, const std::function<void(const NeesTrial&)>& sink,
                  const std::atomic<bool>* stop) {
  options.Check();
  CheckNeesStudy(options);
  for (const Sweep& sweep : options.sweeps) {
    for (std::size_t v = 0; v < sweep.values.size(); ++v) {
      const SimulationOptions simulation = AtValue(options.base, sweep.kind, sweep.values[v]);
      for (int i = 0; i < options.trials; ++i) {
        if (stop != nullptr && *stop) return;
        NeesTrial trial;
        trial.sweep = sweep.kind;
        trial.value = sweep.values[v];
        trial.trial = i;
        trial.seed = SceneSeed(options.seed, v, i);
        MeasureNees(MakeSimulatedScene(simulation, trial.seed, false), options.max_iterations,
                    &trial);
        sink(trial);
      }
    }
  }
}

Interval MeanNeesInterval(int degrees_of_freedom, int runs, double share) {
  // The sum of the runs is chi-square distributed, too, with all their degrees of freedom.
  const boost::math::chi_squared sum(static_cast<double>(degrees_of_freedom) * runs);
  const double outside = 0.5 * (1.0 - share);
  return {boost::math::quantile(sum, outside) / runs,
          boost::math::quantile(boost::math::complement(sum, outside)) / runs};
}

std::vector<NeesSummary> SummariseNees(const std::vector<NeesTrial>& trials) {
  std::vector<std::vector<const NeesTrial*>> groups;
  for (const NeesTrial& trial : trials) {
    // Trials of a value come one after another.
    if (groups.empty() || groups.back().front()->value != trial.value ||
        groups.back().front()->sweep != trial.sweep) {
      groups.emplace_back();
    }
    groups.back().push_back(&trial);
  }
  std::vector<NeesSummary> summaries;
  for (const auto& group : groups) summaries.push_back(SummaryOf(group));
  return summaries;
}

std::string DescribeNees(const NeesSummary& s) {
  return fmt::format(
      "{} {}: mean NEES {:.3f} of {} runs with {} degrees of freedom ({:.4f} of them), 95 % "
      "interval [{:.3f}, {:.3f}]: {}; median {:.3f}, largest {:.3f}, {:.1f} % of the runs within "
      "95 %\n",
      SweepNames().at(static_cast<std::size_t>(s.sweep)), s.value, s.mean, s.runs,
      s.degrees_of_freedom, s.mean / s.degrees_of_freedom, s.mean_interval.low,
      s.mean_interval.high,
      s.consistent()                  ? "consistent"
      : s.mean > s.mean_interval.high ? "NOT consistent, errors are larger than claimed"
                                      : "NOT consistent, errors are smaller than claimed",
      s.median, s.largest, 100.0 * s.share_in_95);
}

}  // namespace lamina
