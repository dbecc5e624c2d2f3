// The origin of a run's map in the frame of its poses: of poses on a national grid, maps are written
// near the origin, where float32 holds millimetres.
#pragma once

#include <Eigen/Core>
#include <string>

#include "core/geometry/scan.h"

namespace lamina {

// `map_origin_m` of summary.json in the folder of a run; zero where it does not say.
Eigen::Vector3d ReadMapOrigin(const std::string& folder);

// The poses in the frame of the map.
void MoveIntoMap(const Eigen::Vector3d& origin, Trajectory* poses);

}  // namespace lamina
