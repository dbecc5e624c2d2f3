// What summary.json in the folder of a run says to commands that can do without it.
//
// The origin of a run's map is in the frame of its poses: of poses on a national grid, maps are
// written near the origin, where float32 holds millimetres.
#pragma once

#include <Eigen/Core>
#include <nlohmann/json.hpp>
#include <string>

#include "core/geometry/scan.h"

namespace lamina {

// An empty object where there is none, or what is there is none.
nlohmann::json ReadSummaryIfAny(const std::string& folder);

// `map_origin_m`; zero where it is not said.
Eigen::Vector3d ReadMapOrigin(const std::string& folder);

// The trajectory with this added to all positions.
Trajectory MovedBy(const Eigen::Vector3d& t, Trajectory trajectory);

}  // namespace lamina
