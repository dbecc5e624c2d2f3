#include "frontend/scan/sensor_intrinsics.h"

#include <cmath>

#include "core/base/parallel.h"

namespace lamina {
namespace {

constexpr double kLeastRadiusM = 1e-6;  // about the z axis

// How the points of a cluster move: by A about their mean, which goes to `mean`.
struct LinearMove {
  Eigen::Matrix3d A = Eigen::Matrix3d::Identity();
  Eigen::Vector3d mean;
};

LinearMove MoveAt(const Eigen::Vector3d& mu, const Intrinsics& offsets) {
  LinearMove move;
  move.mean = mu;
  const double rho = mu.head<2>().norm();
  if (rho < kLeastRadiusM) return move;
  const IntrinsicsFieldJacobians F = IntrinsicsFieldJacobiansAt(mu);
  move.A += offsets(0) * F.elevation + offsets(1) * F.range;
  const double cosine = std::cos(offsets(0)), sine = std::sin(offsets(0));
  move.mean << (cosine - sine * mu.z() / rho) * mu.head<2>(), cosine * mu.z() + sine * rho;
  move.mean *= 1.0 + offsets(1) / mu.norm();
  return move;
}

void Correct(const Intrinsics& offsets, TimedCluster* cluster) {
  PointCluster& points = cluster->points;
  const LinearMove move = MoveAt(points.mean, offsets);
  points.mean = move.mean;
  points.scatter = points.scatter.Rotated(move.A);  // A S A', whatever A
  cluster->point_time = move.A * cluster->point_time;
}

}  // namespace

IntrinsicsField IntrinsicsFieldAt(const Eigen::Vector3d& p) {
  const double rho = p.head<2>().norm();
  IntrinsicsField field;
  field.col(0) << -p.z() / rho * p.head<2>(), rho;
  field.col(1) = p.normalized();
  return field;
}

IntrinsicsFieldJacobians IntrinsicsFieldJacobiansAt(const Eigen::Vector3d& p) {
  const double rho = p.head<2>().norm(), range = p.norm();
  const Eigen::Vector2d h = p.head<2>() / rho;
  const Eigen::Vector3d d = p / range;
  IntrinsicsFieldJacobians F;
  F.elevation.setZero();
  F.elevation.topLeftCorner<2, 2>() =
      -p.z() / rho * (Eigen::Matrix2d::Identity() - h * h.transpose());
  F.elevation.topRightCorner<2, 1>() = -h;
  F.elevation.bottomLeftCorner<1, 2>() = h.transpose();
  F.range = (Eigen::Matrix3d::Identity() - d * d.transpose()) / range;
  return F;
}

std::vector<TimedCluster> Corrected(std::vector<TimedCluster> clusters, const Intrinsics& offsets) {
  ParallelChunks(clusters.size(), 2048, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) Correct(offsets, &clusters[i]);
  });
  return clusters;
}

}  // namespace lamina
