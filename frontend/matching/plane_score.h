// How well clusters of a scan fit the map's planes at one pose.
#pragma once

#include "core/geometry/point_cluster.h"
#include "core/geometry/robust_kernel.h"
#include "core/geometry/se3.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/line_of_sight.h"

namespace lamina {

// The plane around p; null if there is none.
inline const Surface* PlaneAt(const VoxelMap& map, const Eigen::Vector3d& p) {
  if (!map.CanHold(p)) return nullptr;
  const VoxelMap::NodeId id = map.FindSurface(p);
  if (id == VoxelMap::kNoNode || map.kind(id) != Surface::Kind::kPlane) return nullptr;
  return &map.plane(id);
}

// GemanMcClureWeight((distance / scale_m)^2) of a cluster's mean and the plane around it, times
// SightWeight: a plane that the sensor could not have seen from there speaks against the pose.
class PlaneScore {
 public:
  static constexpr double kNone = -1.0;

  PlaneScore(const SE3& T_world_lidar, const VoxelMap& map, double scale_m)
      : R_(T_world_lidar.R()),
        t_(T_world_lidar.t),
        map_(map),
        inverse2_(1.0 / (scale_m * scale_m)) {}

  // In [0, 1]; kNone where there is no plane.
  double Of(const PointCluster& cluster) const {
    const Eigen::Vector3d p = InMap(cluster);
    const Surface* plane = PlaneAt(map_, p);
    return plane == nullptr ? kNone : Fit(*plane, p);
  }

  // The plane around the cluster; null if there is none.
  const Surface* PlaneOf(const PointCluster& cluster) const {
    return PlaneAt(map_, InMap(cluster));
  }

  // In [0, 1], as if this plane extended as far as the cluster.
  double On(const Surface& plane, const PointCluster& cluster) const {
    return Fit(plane, InMap(cluster));
  }

 private:
  Eigen::Vector3d InMap(const PointCluster& cluster) const { return R_ * cluster.mean + t_; }
  double Fit(const Surface& plane, const Eigen::Vector3d& p) const {
    const Eigen::Vector3d normal = plane.normal.cast<double>();
    const double distance = normal.dot(p - plane.mean);
    return SightWeight(plane, normal, p - t_) * GemanMcClureWeight(distance * distance * inverse2_);
  }

  Eigen::Matrix3d R_;
  Eigen::Vector3d t_;
  const VoxelMap& map_;
  double inverse2_;
};

}  // namespace lamina
