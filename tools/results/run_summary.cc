#include "tools/results/run_summary.h"

#include <algorithm>
#include <filesystem>

#include "io/file/text_input.h"

namespace lamina {

nlohmann::json ReadSummaryIfAny(const std::string& folder) {
  const std::filesystem::path path = std::filesystem::path(folder) / "summary.json";
  if (!std::filesystem::exists(path)) return nlohmann::json::object();
  nlohmann::json summary = nlohmann::json::parse(ReadFile(path.string()), nullptr, false);
  return summary.is_object() ? summary : nlohmann::json::object();
}

Eigen::Vector3d ReadMapOrigin(const std::string& folder) {
  const nlohmann::json origin = ReadSummaryIfAny(folder).value("map_origin_m", nlohmann::json());
  const auto is_number = [](const nlohmann::json& number) { return number.is_number(); };
  if (!origin.is_array() || origin.size() != 3 ||
      !std::all_of(origin.begin(), origin.end(), is_number))
    return Eigen::Vector3d::Zero();
  return {origin[0].get<double>(), origin[1].get<double>(), origin[2].get<double>()};
}

Trajectory MovedBy(const Eigen::Vector3d& t, Trajectory trajectory) {
  for (StampedPose& pose : trajectory) pose.T_world_lidar.t += t;
  return trajectory;
}

}  // namespace lamina
