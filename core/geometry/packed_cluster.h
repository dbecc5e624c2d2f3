// A point cluster at rest: 40 bytes in place of 80.
//
// Single precision, relative to a centre near the points (that of a voxel around them) and, for the
// second moments, to their number: as exact far from the world's origin as near it. Means are kept
// to 6e-8 of their distance from the centre, covariances to 6e-8 of their largest entry: for points
// in a cube of 0.8 m that is the variance of a plane less than 0.1 mm thick.
#pragma once

#include <Eigen/Core>

#include "core/geometry/cluster_moments.h"
#include "core/geometry/point_cluster.h"

namespace lamina {

struct PackedCluster {
  float count = 0.0F;
  float mean[3] = {0.0F, 0.0F, 0.0F};                          // from the centre, metres
  float covariance[6] = {0.0F, 0.0F, 0.0F, 0.0F, 0.0F, 0.0F};  // xx xy xz yy yz zz, m^2

  bool Empty() const { return count <= 0.0F; }

  static PackedCluster Of(const PointCluster& cluster, const Eigen::Vector3d& centre) {
    PackedCluster packed;
    packed.count = static_cast<float>(cluster.count);
    if (packed.Empty()) return PackedCluster();
    for (int axis = 0; axis < 3; ++axis) {
      packed.mean[axis] = static_cast<float>(cluster.mean[axis] - centre[axis]);
    }
    const Symmetric3 c = cluster.Covariance();
    const double values[6] = {c.xx, c.xy, c.xz, c.yy, c.yz, c.zz};
    for (int i = 0; i < 6; ++i) packed.covariance[i] = static_cast<float>(values[i]);
    return packed;
  }

  PointCluster Unpacked(const Eigen::Vector3d& centre) const {
    PointCluster cluster;
    if (Empty()) return cluster;
    cluster.count = static_cast<double>(count);
    for (int axis = 0; axis < 3; ++axis) {
      cluster.mean[axis] = centre[axis] + static_cast<double>(mean[axis]);
    }
    const float* c = covariance;
    cluster.scatter = Symmetric3{c[0], c[1], c[2], c[3], c[4], c[5]} * cluster.count;
    return cluster;
  }

  // About the centre that it was packed with.
  ClusterMoments Moments() const {
    ClusterMoments m;
    m.count = static_cast<double>(count);
    const Eigen::Vector3d offset = Eigen::Map<const Eigen::Vector3f>(mean).cast<double>();
    const float* c = covariance;
    m.first = m.count * offset;
    m.second = Symmetric3{c[0], c[1], c[2], c[3], c[4], c[5]} * m.count;
    m.second.AddOuter(m.count, offset);
    return m;
  }
};
static_assert(sizeof(PackedCluster) == 40);

}  // namespace lamina
