#include "tools/compare/results/rows.h"

#include <fmt/format.h>

#include <array>
#include <cstdint>
#include <fstream>

#include "tools/cli/common.h"

namespace lamina {
namespace {

nlohmann::json ToJson(const StructuralError& e) {
  return {{"points", e.points},         {"mean_m", e.mean_m},
          {"median_m", e.median_m},     {"percentile90_m", e.percentile90_m},
          {"within_5cm", e.within_5cm}, {"distribution", e.distribution}};
}

StructuralError StructureFromJson(const nlohmann::json& json) {
  StructuralError e;
  json.at("points").get_to(e.points);
  json.at("mean_m").get_to(e.mean_m);
  json.at("median_m").get_to(e.median_m);
  json.at("percentile90_m").get_to(e.percentile90_m);
  json.at("within_5cm").get_to(e.within_5cm);
  json.at("distribution").get_to(e.distribution);
  return e;
}

}  // namespace

nlohmann::json ToJson(const CompareRow& row) {
  nlohmann::json poses = nlohmann::json::array();
  for (const SE3& T : row.poses) {
    poses.push_back({T.q.x(), T.q.y(), T.q.z(), T.q.w(), T.t.x(), T.t.y(), T.t.z()});
  }
  nlohmann::json json = {{"sequence", row.sequence},
                         {"method", row.method},
                         {"fingerprint", row.fingerprint},
                         {"good", row.good},
                         {"reason", row.reason},
                         {"time_limit_s", row.time_limit_s},
                         {"wall_s", row.wall_s},
                         {"cpu_s", row.cpu_s},
                         {"peak_rss_bytes", row.peak_rss_bytes},
                         {"solve_s", row.solve_s},
                         {"rounds", row.rounds},
                         {"iterations", row.iterations},
                         {"planes", row.planes},
                         {"poses_qxyzw_txyz", poses}};
  if (row.structure) json["structure"] = ToJson(*row.structure);
  return json;
}

CompareRow RowFromJson(const nlohmann::json& json) {
  CompareRow row;
  json.at("sequence").get_to(row.sequence);
  json.at("method").get_to(row.method);
  json.at("fingerprint").get_to(row.fingerprint);
  json.at("good").get_to(row.good);
  json.at("reason").get_to(row.reason);
  json.at("time_limit_s").get_to(row.time_limit_s);
  json.at("wall_s").get_to(row.wall_s);
  json.at("cpu_s").get_to(row.cpu_s);
  json.at("peak_rss_bytes").get_to(row.peak_rss_bytes);
  json.at("solve_s").get_to(row.solve_s);
  json.at("rounds").get_to(row.rounds);
  json.at("iterations").get_to(row.iterations);
  json.at("planes").get_to(row.planes);
  for (const nlohmann::json& pose : json.at("poses_qxyzw_txyz")) {
    const auto v = pose.get<std::array<double, 7>>();
    row.poses.emplace_back(Eigen::Quaterniond(v[3], v[0], v[1], v[2]),
                           Eigen::Vector3d(v[4], v[5], v[6]));
  }
  if (json.contains("structure")) row.structure = StructureFromJson(json["structure"]);
  return row;
}

void WriteRow(const std::string& path, const CompareRow& row) {
  WriteTextFile(path, ToJson(row).dump(1) + "\n");
}

std::optional<CompareRow> ReadRow(const std::string& path, const std::string& fingerprint) {
  std::ifstream file(path);
  if (!file) return std::nullopt;
  try {
    CompareRow row = RowFromJson(nlohmann::json::parse(file));
    if (row.fingerprint == fingerprint) return row;
  } catch (const nlohmann::json::exception&) {
    // As good as none: the row is made again.
  }
  return std::nullopt;
}

std::string Fingerprint(const std::string& text) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const char c : text) {
    hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
  }
  return fmt::format("{:016x}", hash);
}

}  // namespace lamina
