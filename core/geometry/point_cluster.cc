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

PointCluster TimedCluster::DeskewedTo(double time_s, const SweepMotion& motion) const {
  const Vector6d twist = motion.TwistAt(time_s);
  const Eigen::Vector3d w = twist.head<3>();
  const double offset_s = mean_time_s - time_s;
  PointCluster local = points;
  if (time_scatter == 0.0 && offset_s == 0.0) return local;
  const Eigen::Vector3d c = w.cross(points.mean) + twist.tail<3>();
  const double spread2 = time_scatter / points.count;
  const double second =
      0.5 * (spread2 * (1.0 - 0.15 * w.squaredNorm() * spread2) + offset_s * offset_s);
  local.mean += offset_s * c + w.cross(point_time) / points.count +
                second * (w.cross(c) + motion.acceleration.head<3>().cross(points.mean) +
                          motion.acceleration.tail<3>());
  const Eigen::Vector3d& k = point_time;
  Symmetric3& s = local.scatter;
  s.xx += 2.0 * c.x() * k.x();
  s.xy += c.x() * k.y() + c.y() * k.x();
  s.xz += c.x() * k.z() + c.z() * k.x();
  s.yy += 2.0 * c.y() * k.y();
  s.yz += c.y() * k.z() + c.z() * k.y();
  s.zz += 2.0 * c.z() * k.z();
  s.AddOuter(time_scatter, c);
  return local;
}

PointCluster TimedCluster::Deskewed(const SweepMotion& motion) const {
  const PointCluster local = DeskewedTo(mean_time_s, motion);
  return mean_time_s == 0.0 ? local : local.Moved(motion.PoseAt(mean_time_s));
}

}  // namespace lamina
