// Planes of the map that a scan sees through, and which are therefore none.
//
// A surface is opaque: the beams towards it end on it. Where one ring's line on the floor of a long
// corridor crosses one column of points on its wall, both lie in a plane, as any two lines do that
// cross. A node that holds nothing else is thin, broad, faces the sensor, and moves along with it.
// Few of the beams towards such a plane end on its two lines; all others pass between them:
//
//     passed / hit > 0.3,
//
// both counted in points of one scan. A point has passed if it lies behind the plane by more than
// 0.2 m, and the line of sight to it crosses the plane x within two standard deviations of the
// mean m of its points,
//
//     sum_k ((x - m) . u_k)^2 / l_k < 4,    (l_k, u_k) the eigenvalues and axes along the plane.
//
// An even surface is narrower than this ellipse by a seventh, so that some beams pass its edges.
// A pane of glass is seen through as well, and so is the place of a thing that has gone.
#pragma once

#include <cstdint>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"
#include "core/map/surface.h"

namespace lamina {

// The lines of sight to the means of a scan's clusters. Thread-safe.
class BeamsOfScan {
 public:
  BeamsOfScan(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar);

  // `members`: the points of which the plane is made, in the world; `hit`: points of the scan on
  // it.
  bool SeeThrough(const Surface& plane, const PointCluster& members, double hit) const;

 private:
  Eigen::Vector3d sensor_;                       // in the world
  std::vector<float> rays_x_, rays_y_, rays_z_;  // from there to the mean of each cluster
  std::vector<std::int32_t> points_;             // of each cluster
};

}  // namespace lamina
