#include "frontend/matching/seen_through.h"

#include <algorithm>
#include <cmath>

namespace lamina {

BeamsOfScan::BeamsOfScan(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar)
    : sensor_(T_world_lidar.t),
      ends_(3, static_cast<Eigen::Index>(clusters.size())),
      points_(static_cast<Eigen::Index>(clusters.size())) {
  const Eigen::Matrix3d R = T_world_lidar.R();
  Eigen::Index i = 0;
  for (const PointCluster& cluster : clusters) {
    ends_.col(i) = R * cluster.mean + sensor_;
    points_(i++) = cluster.count;
  }
}

bool BeamsOfScan::SeeThrough(const Surface& plane, const PointCluster& members, double hit) const {
  constexpr double kMostPassing = 0.3;
  return Passed(plane, members) > kMostPassing * hit;
}

double BeamsOfScan::Passed(const Surface& plane, const PointCluster& members) const {
  // A step, a frame or an error of the range puts points behind a surface by less than kBehindM.
  constexpr double kBehindM = 0.2, kSigmas2 = 4.0, kLeastVariance = 1e-8;
  const Eigen::Vector3d normal = plane.normal.cast<double>();
  const double sensor_off = normal.dot(sensor_ - members.mean);
  const double side = sensor_off < 0.0 ? -1.0 : 1.0;
  // Along the plane: the thinnest axis is the normal.
  const Eigen3 eigen = EigenDecompose(members.Covariance());
  Eigen::Index thinnest = 0;
  eigen.l.minCoeff(&thinnest);
  Eigen::Matrix3d along = Eigen::Matrix3d::Zero();
  for (int k = 0; k < 3; ++k) {
    if (k == thinnest) continue;
    const Eigen::Vector3d axis = eigen.u.col(k);
    along += axis * axis.transpose() / std::max(eigen.l(k), kLeastVariance);
  }
  double passed = 0.0;
  for (Eigen::Index i = 0; i < ends_.cols(); ++i) {
    const Eigen::Vector3d end = ends_.col(i);
    const double off = normal.dot(end - members.mean);
    if (side * off > -kBehindM) continue;
    const double share = sensor_off / (sensor_off - off);
    const Eigen::Vector3d crossing = sensor_ + share * (end - sensor_) - members.mean;
    if (crossing.dot(along * crossing) < kSigmas2) passed += points_(i);
  }
  return passed;
}

}  // namespace lamina
