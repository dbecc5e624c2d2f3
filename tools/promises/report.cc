#include "tools/promises/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace lamina {
namespace {

template <typename Value>
auto Largest(const PromiseResults& results, const Value& value) {
  auto largest = value(results.trials.front());
  for (const SeedResult& trial : results.trials) largest = std::max(largest, value(trial));
  return largest;
}

std::string Most(std::size_t count, const std::optional<int>& most) {
  return most ? fmt::format("{} / {}", count, *most) : fmt::format("{} / any", count);
}

std::string IfAny(double figure) {
  return std::isnan(figure) ? "-" : fmt::format("{:.1f}", figure);
}

// What was promised of the poses, after what came of it.
std::string Bound(const PromiseResults& results) {
  if (std::isfinite(results.promise.drift_percent)) {
    const auto drift = [](const SeedResult& t) { return t.verdict.drift_percent; };
    return fmt::format("{:.2f} % / {} %", Largest(results, drift), results.promise.drift_percent);
  }
  const auto worst = [](const SeedResult& t) { return t.verdict.worst_m; };
  return fmt::format("{:.3f} / {}", Largest(results, worst), results.promise.within_m);
}

std::string TableRow(const PromiseResults& results) {
  const Promise& promise = results.promise;
  double cpu_s = 0.0, frames = 0.0;
  for (const SeedResult& trial : results.trials) {
    cpu_s += trial.cpu_s;
    frames += static_cast<double>(trial.frames);
  }
  const std::size_t all = results.trials.size();
  return fmt::format(
      "| {} | {} | {} | {:.2f} | {} | {} | {} | {} | {} | {:.1f} |\n", promise.name,
      results.kept() == all ? fmt::format("all {}", all)
                            : fmt::format("**{} of {}**", results.kept(), all),
      Bound(results), Largest(results, [](const SeedResult& t) { return t.verdict.worst_deg; }),
      Most(Largest(results, [](const SeedResult& t) { return t.verdict.lost; }), promise.lost),
      Most(Largest(results, [](const SeedResult& t) { return t.verdict.degenerate; }),
           promise.degenerate),
      Largest(results, [](const SeedResult& t) { return t.verdict.pieces; }),
      IfAny(Largest(results, [](const SeedResult& t) { return t.covariance.nees_per_dof; })),
      IfAny(Largest(results, [](const SeedResult& t) { return t.covariance.worst_ratio; })),
      1e3 * cpu_s / frames);
}

}  // namespace

std::size_t PromiseResults::kept() const {
  return static_cast<std::size_t>(
      std::count_if(trials.begin(), trials.end(), [](const auto& t) { return t.verdict.kept; }));
}

std::string PromiseTable(const std::vector<PromiseResults>& results) {
  std::string text =
      "| scene | kept | worst m / promised | worst deg | lost / promised | degenerate / promised | "
      "pieces | NEES / 6 | error / sigma | CPU ms a frame |\n"
      "|---|---|---|---|---|---|---|---|---|---|\n";
  for (const PromiseResults& r : results) text += TableRow(r);
  std::string broken;
  for (const PromiseResults& r : results) {
    for (const SeedResult& t : r.trials) {
      if (t.verdict.kept) continue;
      broken += fmt::format("- {}, seed {}: {}; farthest off at scan {}\n", r.promise.name, t.seed,
                            t.verdict.broken, t.verdict.worst_frame);
    }
  }
  if (!broken.empty()) text += "\nNot kept:\n\n" + broken;
  return text;
}

std::string TrialsCsv(const std::vector<PromiseResults>& results) {
  std::string text =
      "name,seed,kept,worst_m,drift_percent,worst_deg,worst_frame,judged,lost,degenerate,pieces,"
      "nees_per_dof,sigma_ratio,cpu_s\n";
  for (const PromiseResults& r : results) {
    for (const SeedResult& t : r.trials) {
      const Verdict& v = t.verdict;
      text += fmt::format("{},{},{},{:.5f},{:.4f},{:.4f},{},{},{},{},{},{:.3f},{:.3f},{:.3f}\n",
                          r.promise.name, t.seed, v.kept ? 1 : 0, v.worst_m, v.drift_percent,
                          v.worst_deg, v.worst_frame, v.judged, v.lost, v.degenerate, v.pieces,
                          t.covariance.nees_per_dof, t.covariance.worst_ratio, t.cpu_s);
    }
  }
  return text;
}

std::string FramesCsv(const std::vector<TrialFrame>& frames, const Verdict& verdict) {
  std::string text =
      "scan,stamp_s,status,piece,error_m,error_deg,worst_sigma_m,x,y,z,true_x,true_y,true_z\n";
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const TrialFrame& f = frames[i];
    const Eigen::Vector3d& p = f.T_world_lidar.t;
    const Eigen::Vector3d& q = f.T_world_lidar_true.t;
    text += fmt::format("{},{:.3f},{},{},{:.4f},{:.3f},{:.5f},{:.4f},{:.4f},{:.4f},", i,
                        SecondsBetween(0, f.stamp_ns), f.status, f.piece, verdict.error_m[i],
                        verdict.error_deg[i], f.worst_sigma_m, p.x(), p.y(), p.z());
    text += fmt::format("{:.4f},{:.4f},{:.4f}\n", q.x(), q.y(), q.z());
  }
  return text;
}

}  // namespace lamina
