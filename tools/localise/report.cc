#include "tools/localise/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

namespace lamina {
namespace {

constexpr double kInTimeS = 5.0;

struct CaseRow {
  std::size_t maps = 0, on_map = 0, in_time = 0, later = 0, other = 0, wrong = 0;
  double way_m = 0.0;
  std::map<std::string, int> stages;

  void Add(const LocalisationTrial& trial) {
    ++maps;
    for (const WindowResult& window : trial.windows) Add(window);
  }
  void Add(const WindowResult& window) {
    const bool right = window.claimed && window.right;
    wrong += window.claimed && !window.right ? 1 : 0;
    if (window.kind != WindowKind::kOnMap) {
      ++other;
      return;
    }
    ++on_map;
    way_m += window.way_m;
    const bool timely = right && window.after_s <= kInTimeS;
    in_time += timely ? 1 : 0;
    later += right && !timely ? 1 : 0;
    if (!window.claimed) ++stages[window.stage];
  }
};

std::string Line(const std::string& name, const CaseRow& row) {
  std::string stages;
  std::vector<std::pair<std::string, int>> sorted(row.stages.begin(), row.stages.end());
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  for (const auto& [stage, count] : sorted)
    stages += fmt::format("{}{} {}", stages.empty() ? "" : ", ", count, stage);
  const double share =
      row.on_map == 0 ? 0.0
                      : 100.0 * static_cast<double>(row.in_time) / static_cast<double>(row.on_map);
  return fmt::format("| {} | {} | {} | {} ({:.0f} %) | {} | {} | {} | {} |\n", name, row.maps,
                     row.on_map, row.in_time, share, row.later, row.other, row.wrong, stages);
}

}  // namespace

std::string LocalisationTable(const std::vector<LocalisationTrial>& trials) {
  std::vector<std::string> names;
  std::map<std::string, CaseRow> rows;
  CaseRow all;
  for (const LocalisationTrial& trial : trials) {
    if (rows.count(trial.name) == 0) names.push_back(trial.name);
    rows[trial.name].Add(trial);
    all.Add(trial);
  }
  std::string text = fmt::format(
      "| case | maps | windows on the map | right within {:.0f} s | later | windows off the map "
      "and "
      "elsewhere | wrong claims | not claimed on the map |\n|---|---|---|---|---|---|---|---|\n",
      kInTimeS);
  for (const std::string& name : names) text += Line(name, rows[name]);
  return text + Line("all", all);
}

std::string WindowsCsv(const std::vector<LocalisationTrial>& trials) {
  std::string text =
      "case,seed,kind,first_scan,reversed,yaw_deg,tilt_deg,way_m,claimed,right,after_s,error_m,"
      "error_deg,stage,looks\n";
  for (const LocalisationTrial& trial : trials) {
    for (const WindowResult& w : trial.windows) {
      text +=
          fmt::format("{},{},{},{},{},{:.1f},{:.1f},{:.2f},{},{},{:.1f},{:.3f},{:.2f},{},{}\n",
                      trial.name, trial.seed, ToString(w.kind), w.first_scan, w.reversed ? 1 : 0,
                      w.yaw_deg, w.tilt_deg, w.way_m, w.claimed ? 1 : 0, w.right ? 1 : 0, w.after_s,
                      w.error_m, w.error_deg, w.stage, fmt::join(w.reasons, "; "));
    }
  }
  return text;
}

std::string LooksCsv(const std::vector<LocalisationTrial>& trials) {
  std::string text =
      "case,seed,window,kind,after_s,error_m,error_deg,converged,planes,overlap,structure,facing,"
      "residual_sigmas,met,gone,piece,same_as_best,reason\n";
  for (const LocalisationTrial& trial : trials) {
    for (std::size_t i = 0; i < trial.windows.size(); ++i) {
      for (const ComparedPose& pose : trial.windows[i].compared) {
        const SubmapMatch& match = pose.candidate.match;
        text += fmt::format(
            "{},{},{},{},{:.1f},{:.3f},{:.2f},{},{},{:.4f},{:.4f},{:.1f},{:.3f},{:.4f},{:.4f},{},{}"
            ",{}\n",
            trial.name, trial.seed, i, ToString(trial.windows[i].kind), pose.after_s, pose.error_m,
            pose.error_deg, match.met_planes ? 1 : 0, match.planes, match.overlap, match.structure,
            match.facing, match.residual_sigmas, pose.candidate.met, pose.candidate.gone,
            pose.candidate.place.piece, pose.candidate.same_as_best ? 1 : 0, pose.candidate.reason);
      }
    }
  }
  return text;
}

std::size_t WrongClaims(const std::vector<LocalisationTrial>& trials) {
  std::size_t wrong = 0;
  for (const LocalisationTrial& trial : trials) {
    wrong += static_cast<std::size_t>(
        std::count_if(trial.windows.begin(), trial.windows.end(),
                      [](const WindowResult& w) { return w.claimed && !w.right; }));
  }
  return wrong;
}

}  // namespace lamina
