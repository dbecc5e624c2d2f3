// Scans and ways whose steadiness is judged (steady_motion.h).
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/geometry/point_cluster.h"

namespace lamina {

// One of the scans.
struct SteadyScan {
  double time_s = 0.0;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  // where the sensor was, at x = 0
  // In the world, but without the way along u: as if the sensor had been at x = 0 in all scans, and
  // had stood still along u during each of them.
  std::vector<PointCluster> clusters;
  // When each cluster was measured, after time_s. Empty where all are of one instant.
  std::vector<double> cluster_times_s;
};

// Positions along u, metres from that of the first scan, and speeds.
struct WayAlong {
  std::vector<double> positions_m, speeds_m_s;
};

}  // namespace lamina
