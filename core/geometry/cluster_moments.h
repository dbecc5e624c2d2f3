// The sums of a point cluster about a fixed origin.
//
//     n,    f = sum (p - o),    S = sum (p - o)(p - o)'
//
// Where clusters join and leave one place again and again (core/map), sums are added and taken away
// without a division, which the centred form of a PointCluster needs each time. The origin must be
// near the points: covariances are exact to 1e-16 of the squared distance from it, in a voxel of 2
// m far below the square of a micrometre.
#pragma once

#include <Eigen/Core>

#include "core/geometry/point_cluster.h"

namespace lamina {

struct ClusterMoments {
  double count = 0.0;
  Eigen::Vector3d first = Eigen::Vector3d::Zero();
  Symmetric3 second;

  bool Empty() const { return count <= 0.0; }

  static ClusterMoments Of(const PointCluster& cluster, const Eigen::Vector3d& origin) {
    ClusterMoments m;
    const Eigen::Vector3d offset = cluster.mean - origin;
    m.count = cluster.count;
    m.first = cluster.count * offset;
    m.second = cluster.scatter;
    m.second.AddOuter(cluster.count, offset);
    return m;
  }

  ClusterMoments& operator+=(const ClusterMoments& o) {
    count += o.count;
    first += o.first;
    second += o.second;
    return *this;
  }

  // Removes what was added before. Removing all leaves exactly nothing.
  ClusterMoments& operator-=(const ClusterMoments& o) {
    const double left = count - o.count;
    // What is left of a sum whose terms all went is rounding, not a cluster.
    constexpr double kRounding = 1e-9;
    if (left <= kRounding * count) {
      *this = ClusterMoments();
      return *this;
    }
    count = left;
    first -= o.first;
    second += o.second * -1.0;
    return *this;
  }

  // The same points, counted as they were, have moved.
  void Exchange(const PointCluster& before, const PointCluster& after,
                const Eigen::Vector3d& origin) {
    const Eigen::Vector3d change = before.count * (after.mean - before.mean);
    const Eigen::Vector3d m = 0.5 * (after.mean + before.mean) - origin;
    const Symmetric3 &a = after.scatter, &b = before.scatter;
    first += change;
    second += {a.xx - b.xx + 2.0 * change.x() * m.x(),
               a.xy - b.xy + change.x() * m.y() + change.y() * m.x(),
               a.xz - b.xz + change.x() * m.z() + change.z() * m.x(),
               a.yy - b.yy + 2.0 * change.y() * m.y(),
               a.yz - b.yz + change.y() * m.z() + change.z() * m.y(),
               a.zz - b.zz + 2.0 * change.z() * m.z()};
  }

  PointCluster Cluster(const Eigen::Vector3d& origin) const {
    PointCluster cluster;
    if (Empty()) return cluster;
    const Eigen::Vector3d offset = first / count;
    cluster.count = count;
    cluster.mean = origin + offset;
    cluster.scatter = second;
    cluster.scatter.AddOuter(-count, offset);
    return cluster;
  }
};

}  // namespace lamina
