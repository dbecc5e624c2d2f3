#include "tools/results/map_origin.h"

#include <filesystem>
#include <nlohmann/json.hpp>

#include "io/file/text_input.h"

namespace lamina {

Eigen::Vector3d ReadMapOrigin(const std::string& folder) {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  const std::filesystem::path path = std::filesystem::path(folder) / "summary.json";
  if (!std::filesystem::exists(path)) return origin;
  const auto summary = nlohmann::json::parse(ReadFile(path.string()), nullptr, false);
  if (!summary.is_object() || !summary.contains("map_origin_m")) return origin;
  const nlohmann::json& given = summary["map_origin_m"];
  for (std::size_t i = 0; i < 3 && given.is_array() && given.size() == 3; ++i) {
    if (given[i].is_number()) origin(static_cast<Eigen::Index>(i)) = given[i].get<double>();
  }
  return origin;
}

void MoveIntoMap(const Eigen::Vector3d& origin, Trajectory* poses) {
  for (StampedPose& pose : *poses) pose.T_world_lidar.t -= origin;
}

}  // namespace lamina
