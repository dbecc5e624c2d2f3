#include "tools/register/report.h"

#include <fmt/format.h>

#include "tools/results/verdict/process_report.h"

namespace lamina {
namespace {

const char* KindName(BundleFault::Kind kind) {
  switch (kind) {
    case BundleFault::Kind::kTooFewPlanes:
      return "too_few_planes";
    case BundleFault::Kind::kApart:
      return "apart";
    case BundleFault::Kind::kOpenDirection:
      return "open_direction";
    case BundleFault::Kind::kLeapt:
      return "leapt";
  }
  return "unknown";
}

nlohmann::json Faults(const std::vector<BundleFault>& faults) {
  nlohmann::json list = nlohmann::json::array();
  for (const BundleFault& fault : faults) {
    nlohmann::json entry = {
        {"kind", KindName(fault.kind)}, {"frame", fault.frame}, {"text", fault.Describe()}};
    if (fault.kind == BundleFault::Kind::kOpenDirection) {
      entry["direction"] = std::vector<double>(fault.direction.data(), fault.direction.data() + 6);
      if (!fault.group.empty()) entry["group"] = fault.group;
    }
    list.push_back(entry);
  }
  return list;
}

}  // namespace

RoundTable::RoundTable(const std::string& path) : writer_(path) {
  writer_.Write("round,iteration,cost,step,planes,ms,root_size_m,accepted\n");
}

void RoundTable::Append(const RoundReport& round, const BundleStep& step) {
  writer_.Write(fmt::format("{},{},{:.12g},{:.6g},{},{:.3f},{:.4g},{}\n", round.round,
                            step.iteration, step.cost, step.step, round.planes, step.solve_ms,
                            round.root_size_m, step.accepted ? 1 : 0));
}

void WriteCovariances(const std::string& path, const std::vector<std::size_t>& scans,
                      const std::vector<Matrix6d>& covariances) {
  static const char* const kNames[] = {"rx", "ry", "rz", "x", "y", "z"};
  FileWriter writer(path);
  std::string line = "scan";
  for (int r = 0; r < 6; ++r) {
    for (int c = r; c < 6; ++c) line += fmt::format(",{}_{}", kNames[r], kNames[c]);
  }
  writer.Write(line + "\n");
  for (std::size_t k = 0; k < covariances.size(); ++k) {
    line = std::to_string(scans[k]);
    for (int r = 0; r < 6; ++r) {
      for (int c = r; c < 6; ++c) line += fmt::format(",{:.6g}", covariances[k](r, c));
    }
    writer.Write(line + "\n");
  }
  writer.Commit();
}

nlohmann::json Summarise(const RegistrationResult& result, const std::vector<std::size_t>& scans,
                         const std::string& formulation, const RegistrationFigures& figures,
                         const TrajectoryErrors* errors) {
  double build_ms = 0.0, solve_ms = 0.0;
  int iterations = 0;
  for (const RoundReport& round : result.rounds) {
    build_ms += round.build_ms;
    solve_ms += round.solve_ms;
    iterations += round.iterations;
  }
  nlohmann::json json = {
      {"status", ToString(result.status)},
      {"formulation", formulation},
      {"frames", scans.size()},
      {"skipped_scans", figures.skipped},
      {"rounds", result.rounds.size()},
      {"iterations", iterations},
      {"read_s", figures.read_s},
      {"build_s", 1e-3 * build_ms},
      {"solve_s", 1e-3 * solve_ms},
      {"wall_s", figures.wall_s},
      {"cpu_s", figures.cpu_s},
      {"peak_rss_bytes", PeakRssBytes()},
      {"map_surfels", figures.map_surfels},
      {"faults", Faults(result.faults)},
  };
  if (!result.reason.empty()) json["reason"] = result.reason;
  if (!result.covariance_failure.empty()) json["covariance_failure"] = result.covariance_failure;
  if (!result.rounds.empty()) {
    // Costs of different rounds are of different planes: each is compared within the last one.
    json["misfit_initial_m"] = result.initial_misfit_m;
    json["misfit_final_m"] = result.final_misfit_m;
    json["cost_initial"] = result.rounds.back().initial_cost;
    json["cost_final"] = result.rounds.back().final_cost;
    json["planes"] = result.rounds.back().planes;
    json["observations"] = result.rounds.back().observations;
    json["first_round_cost_initial"] = result.rounds.front().initial_cost;
    json["first_round_cost_final"] = result.rounds.front().final_cost;
  }
  if (errors != nullptr) {
    json["ape_rmse_m"] = errors->ape_rmse_m;
    json["rpe_rmse_m"] = errors->rpe_rmse_m;
  }
  return json;
}

}  // namespace lamina
