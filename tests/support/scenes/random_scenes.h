// Random numbers, poses, clusters and plane scenes that tests share.
#pragma once

#include <tbb/global_control.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"

namespace lamina {

using Points = std::vector<Eigen::Vector3d>;

// A seeded source of draws: the same test sees the same numbers on every run.
class Draws {
 public:
  explicit Draws(unsigned seed) : random_(seed) {}

  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  // sigma may be zero.
  double Normal(double sigma) { return sigma * std::normal_distribution<double>()(random_); }
  // A whole number in [low, high].
  int Integer(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }

  // Uniform in the cube [-half, half]^3.
  Eigen::Vector3d InCube(double half) {
    return {Uniform(-half, half), Uniform(-half, half), Uniform(-half, half)};
  }
  Eigen::Vector3d Direction() {
    return Eigen::Vector3d(Normal(1.0), Normal(1.0), Normal(1.0)).normalized();
  }
  // Rotated by exactly `angle_rad` and shifted by exactly `shift_m`, each in a random direction.
  SE3 Offset(double angle_rad, double shift_m) {
    return SE3(ExpSO3(angle_rad * Direction()), shift_m * Direction());
  }
  // Any rotation, and a translation in a cube.
  SE3 Pose(double half_m) { return SE3(ExpSO3(Uniform(0.0, 3.14) * Direction()), InCube(half_m)); }
  // Body twist of at most these speeds along each axis.
  Vector6d Twist(double rad_per_s, double m_per_s) {
    Vector6d twist;
    twist << InCube(rad_per_s), InCube(m_per_s);
    return twist;
  }
  Points Cloud(int count, const Eigen::Vector3d& centre, double half) {
    Points points;
    for (int i = 0; i < count; ++i) points.push_back(centre + InCube(half));
    return points;
  }

 private:
  std::mt19937 random_;
};

// A square patch of a plane.
struct Patch {
  Eigen::Vector3d centre, u1, u2;  // u1, u2: orthogonal unit vectors in it

  Patch(const Eigen::Vector3d& at, const Eigen::Vector3d& normal) : centre(at) {
    u1 = normal.unitOrthogonal();
    u2 = normal.cross(u1).normalized();
  }
  Eigen::Vector3d Normal() const { return u1.cross(u2); }
  Eigen::Vector3d Point(double half, double sigma_m, Draws* draws) const {
    return centre + draws->Uniform(-half, half) * u1 + draws->Uniform(-half, half) * u2 +
           draws->Normal(sigma_m) * Normal();
  }
};

inline PointCluster ClusterOf(const Points& points) {
  PointCluster cluster;
  for (const Eigen::Vector3d& p : points) cluster.AddPoint(p);
  return cluster;
}

// Largest difference of the means, and of the scatters.
inline double MeanGap(const PointCluster& a, const PointCluster& b) {
  return (a.mean - b.mean).cwiseAbs().maxCoeff();
}
inline double ScatterGap(const PointCluster& a, const PointCluster& b) {
  return (a.scatter.Dense() - b.scatter.Dense()).cwiseAbs().maxCoeff();
}

// While it lives, TBB uses so many threads.
class ThreadLimit {
 public:
  explicit ThreadLimit(std::size_t threads)
      : control_(tbb::global_control::max_allowed_parallelism, threads) {}

 private:
  tbb::global_control control_;
};

}  // namespace lamina
