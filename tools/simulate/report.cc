#include "tools/simulate/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/median.h"

namespace lamina {
namespace {

std::string NameOf(const Formulation* formulation) { return formulation->name; }
const std::string& NameOf(SweepKind kind) {
  return SweepNames().at(static_cast<std::size_t>(kind));
}
const std::string& NameOf(SceneGenerator generator) {
  return SceneGeneratorNames().at(static_cast<std::size_t>(generator));
}

// Empty for "never".
std::string Cell(double value) {
  return std::isfinite(value) ? fmt::format("{:.6g}", value) : std::string();
}

std::string TableCell(double value) {
  return std::isfinite(value) ? fmt::format("{:.4g}", value) : std::string("-");
}

std::string Percent(double share) { return fmt::format("{:.0f} %", 100.0 * share); }

template <typename Member>
double MedianOf(const std::vector<const TrialResult*>& trials, Member member) {
  std::vector<double> values;
  for (const TrialResult* t : trials) values.push_back(static_cast<double>(t->*member));
  return Median(std::move(values));
}

TrialSummary SummaryOf(const std::vector<const TrialResult*>& trials) {
  TrialSummary s;
  const TrialResult& first = *trials.front();
  s.formulation = first.formulation;
  s.sweep = first.sweep;
  s.value = first.value;
  s.trials = static_cast<int>(trials.size());
  s.rot_error_deg = MedianOf(trials, &TrialResult::rot_error_deg);
  s.trans_error_m = MedianOf(trials, &TrialResult::trans_error_m);
  s.cost = MedianOf(trials, &TrialResult::cost);
  s.cost_gap = MedianOf(trials, &TrialResult::cost_gap);
  s.iterations = MedianOf(trials, &TrialResult::iterations);
  s.ms = MedianOf(trials, &TrialResult::ms);
  s.iterations_to_optimum = MedianOf(trials, &TrialResult::iterations_to_optimum);
  s.ms_to_optimum = MedianOf(trials, &TrialResult::ms_to_optimum);
  const auto share = [&](const auto& holds) {
    return static_cast<double>(std::count_if(trials.begin(), trials.end(), holds)) / s.trials;
  };
  s.fits_share = share([](const TrialResult* t) { return t->fits; });
  s.success_share = share([](const TrialResult* t) { return t->success; });
  s.optimum_share =
      share([](const TrialResult* t) { return std::isfinite(t->iterations_to_optimum); });
  return s;
}

// Columns of a Markdown table, padded so that it reads as plain text, too.
std::string Table(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> widths(rows[0].size());
  for (const auto& row : rows) {
    for (std::size_t c = 0; c < row.size(); ++c) widths[c] = std::max(widths[c], row[c].size());
  }
  std::string text;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    for (std::size_t c = 0; c < rows[r].size(); ++c) {
      text += fmt::format("| {:>{}} ", rows[r][c], widths[c]);
    }
    text += "|\n";
    if (r > 0) continue;
    for (const std::size_t width : widths) text += fmt::format("|{:->{}}:", "", width + 1);
    text += "|\n";
  }
  return text;
}

}  // namespace

TrialTable::TrialTable(const std::string& path) : writer_(path) {
  writer_.Write(
      "formulation,sweep,value,trial,seed,rot_error_deg,trans_error_m,cost,cost_gap,iterations,ms,"
      "status,iterations_to_1e-8,ms_to_1e-8,truth_cost,fits,success\n");
}

void TrialTable::Append(const std::vector<TrialResult>& trial) {
  for (const TrialResult& t : trial) {
    writer_.Write(fmt::format(
        "{},{},{},{},{},{:.9g},{:.9g},{:.15g},{:.6g},{},{:.6g},{},{},{},{:.15g},{},{}\n",
        NameOf(t.formulation), NameOf(t.sweep), t.value, t.trial, t.seed, t.rot_error_deg,
        t.trans_error_m, t.cost, t.cost_gap, t.iterations, t.ms, StatusName(t.status),
        Cell(t.iterations_to_optimum), Cell(t.ms_to_optimum), t.truth_cost, t.fits ? 1 : 0,
        t.success ? 1 : 0));
  }
}

std::vector<TrialSummary> SummariseTrials(const std::vector<TrialResult>& results) {
  std::vector<std::vector<const TrialResult*>> groups;
  for (const TrialResult& result : results) {
    const auto same = [&](const std::vector<const TrialResult*>& group) {
      const TrialResult& other = *group.front();
      return other.formulation == result.formulation && other.sweep == result.sweep &&
             other.value == result.value;
    };
    const auto group = std::find_if(groups.begin(), groups.end(), same);
    if (group == groups.end()) {
      groups.push_back({&result});
    } else {
      group->push_back(&result);
    }
  }
  std::vector<TrialSummary> summaries;
  for (const auto& group : groups) summaries.push_back(SummaryOf(group));
  return summaries;
}

nlohmann::json SummaryJson(const StudyOptions& options,
                           const std::vector<TrialSummary>& summaries) {
  const SimulationOptions& base = options.base;
  nlohmann::json json;
  json["options"] = {{"generator", NameOf(base.generator)},
                     {"poses", base.poses},
                     {"planes", base.planes},
                     {"points", base.points},
                     {"noise_m", base.noise_m},
                     {"start_deg", base.start_deg},
                     {"start_m", base.start_m},
                     {"visibility", base.visibility},
                     {"trials", options.trials},
                     {"seed", options.seed},
                     {"max_iterations", options.max_iterations}};
  json["medians"] = nlohmann::json::array();
  for (const TrialSummary& s : summaries) {
    // What is not finite becomes null.
    json["medians"].push_back({{"formulation", NameOf(s.formulation)},
                               {"sweep", NameOf(s.sweep)},
                               {"value", s.value},
                               {"trials", s.trials},
                               {"fits_share", s.fits_share},
                               {"success_share", s.success_share},
                               {"rot_error_deg", s.rot_error_deg},
                               {"trans_error_m", s.trans_error_m},
                               {"cost", s.cost},
                               {"cost_gap", s.cost_gap},
                               {"iterations", s.iterations},
                               {"ms", s.ms},
                               {"optimum_share", s.optimum_share},
                               {"iterations_to_1e-8", s.iterations_to_optimum},
                               {"ms_to_1e-8", s.ms_to_optimum}});
  }
  return json;
}

std::string SummaryTables(const StudyOptions& options, const std::vector<TrialSummary>& summaries) {
  const SimulationOptions& o = options.base;
  std::string text = fmt::format(
      "Scenes `{}`, seed {}, at most {} trials of each value. Where not swept: {} poses, {} "
      "planes,\n{} points, noise {} m, start {} deg and {} m, visibility {}.\nMedians. Fits: "
      "common "
      "cost not above that of the true poses; success: nor above 1 + 1e-6 times\nthe best of the "
      "trial; `to 1e-8`: until within 1e-8 of that best.\n",
      NameOf(o.generator), options.seed, options.trials, o.poses, o.planes, o.points, o.noise_m,
      o.start_deg, o.start_m, o.visibility);
  for (const Sweep& sweep : options.sweeps) {
    std::vector<std::vector<std::string>> rows = {
        {NameOf(sweep.kind), "formulation", "trials", "fits", "success", "rot deg", "trans mm",
         "cost gap", "iterations", "ms", "iterations to 1e-8", "ms to 1e-8"}};
    for (const TrialSummary& s : summaries) {
      if (s.sweep != sweep.kind) continue;
      rows.push_back({fmt::format("{}", s.value), NameOf(s.formulation),
                      fmt::format("{}", s.trials), Percent(s.fits_share), Percent(s.success_share),
                      TableCell(s.rot_error_deg), TableCell(1e3 * s.trans_error_m),
                      fmt::format("{:.1e}", s.cost_gap), TableCell(s.iterations), TableCell(s.ms),
                      TableCell(s.iterations_to_optimum), TableCell(s.ms_to_optimum)});
    }
    if (rows.size() > 1) text += "\n" + Table(rows);
  }
  return text;
}

}  // namespace lamina
