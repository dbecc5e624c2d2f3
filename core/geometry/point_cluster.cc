#include "core/geometry/point_cluster.h"

namespace lamina {

PointCluster& PointCluster::operator-=(const PointCluster& o) {
  if (o.count == 0.0) return *this;
  const double n = count - o.count;
  // What is left of a sum whose terms all went is rounding, not a cluster.
  if (n <= 1e-9 * count) {
    *this = PointCluster();
    return *this;
  }
  const Eigen::Vector3d rest_mean = mean + (o.count / n) * (mean - o.mean);
  const Eigen::Vector3d d = o.mean - rest_mean;
  scatter += o.scatter * -1.0;
  scatter.AddOuter(-n * o.count / count, d);
  mean = rest_mean;
  count = n;
  return *this;
}

}  // namespace lamina
