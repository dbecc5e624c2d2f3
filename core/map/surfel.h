// A planar patch of the map, as it is shown and exported.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace lamina {

struct Surfel {
  Eigen::Vector3d centre;       // mean of the points, frame of its piece, metres
  Eigen::Vector3f normal;       // unit; the sign has no meaning
  Eigen::Vector3f eigenvalues;  // of the covariance, descending, m^2; thickness = sqrt of the last
  std::uint32_t count = 0;      // points
  std::int64_t last_keyframe = 0;  // the last frame that added to it
  std::int64_t piece = 0;          // of the map, in whose frame it is
};

using SurfelMap = std::vector<Surfel>;

}  // namespace lamina
