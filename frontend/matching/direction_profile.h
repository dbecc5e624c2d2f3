// Evidence of planes about a pose along one direction that few of them face.
//
// Where a handful of surfaces hold a direction, the minimum of the cost there is sharp and may
// still be the wrong one: next to it lie others nearly as deep, of things that move, of a column of
// points that moves along with the sensor, of the next edge in a row; and all residuals on one
// surface err together. Curvature tells nothing of that. Here the whole profile along the direction
// is looked at, each block of 4 m counting as one observation, however many clusters it has:
//
//     L(s) = sum_b  kappa a_b (l_b(s) - 1/2)  +  (B - 6)/B sum_b  kappa d_b(s) / (d_0 + d_b(s)),
//
//     l_b = sum_i w_i rho_i / sum_i w_i,     d_b(s) = max_s' F_b(s') - F_b(s),
//
// with w_i the information of cluster i that counts along the direction (degeneracy.h), rho_i in
// [0, 1) twice its kernel's loss (core/geometry/robust_kernel.h) at the place that is s away, and
// a_b = w_b / (w_b + w_0), which fades out blocks that hardly face the direction. The second sum is
// of clusters on planes that do not face it: they tell where these planes end. Moved past the edge
// of a plane a cluster meets another one, which it does not fit, and
//
//     F_b(s) = -sum_i (1 - c_i (1 - rho_i)),    c_i of line_of_sight.h,
//
// counts those of a block that do not fit at the place s. A cluster that meets no plane says
// nothing, and so do planes of fewer than three frames, which end where the points of these do, and
// clusters of one ring or column alone. Nor does w_i count planes that are met flatly (kFlatSine).
// d_0 = 4 clusters are half an edge. Of all B blocks six are fitted by the pose, whatever it is: a
// narrow view of a few walls has no edges to spare. With the prediction (mean m, standard deviation
// p) the posterior is
//
//     P(s) ~ exp(-L(s) - (s - m)^2 / (2 p^2)),
//
// and its mean and standard deviation are what is known of the pose. kappa = 2 makes them agree
// with the errors of generated scenes.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/planes_instead.h"

namespace lamina {

// Straight on along a unit vector of the world, without a turn: a unit vector of the scaled
// tangent.
inline Vector6d StraightAlong(const Eigen::Vector3d& u) {
  Vector6d v = Vector6d::Zero();
  v.tail<3>() = u;
  return v;
}

// Refers to its arguments, which must not change. Thread-safe, as far as `instead` is.
class DirectionProfile {
 public:
  // About a pose, along a unit vector of the scaled tangent. `instead`: gives the planes that stand
  // in for the map's, or is null.
  DirectionProfile(const std::vector<PointCluster>& clusters, const VoxelMap& map,
                   const SE3& T_world_lidar, const Vector6d& direction,
                   PlanesInstead instead = nullptr)
      : clusters_(clusters),
        map_(map),
        instead_(std::move(instead)),
        T_world_lidar_(T_world_lidar),
        direction_(direction),
        floor2_(map.options().noise_floor_m * map.options().noise_floor_m) {}

  // How many blocks face the direction: the sum of a_b.
  double Blocks() const;

  // Mean and standard deviation of the posterior, metres from the pose along the direction.
  struct Posterior {
    double mean_m = 0.0, sigma_m = 0.0;
  };
  Posterior With(double predicted_m, double predicted_sigma_m) const;

  // The pose that is s away.
  SE3 At(double s_m) const;

 private:
  struct Loss {
    double loss = 0.0, blocks = 0.0;
  };
  // A cluster whose loss is computed at one place after the other.
  class MovedCluster;
  // Some of the clusters, and the number of their blocks.
  struct MovedClusters {
    std::vector<PointCluster> clusters;
    std::vector<MovedCluster> moved;
    std::size_t blocks = 0;
  };
  Loss LossAt(double s_m, MovedClusters* of) const;
  template <typename Wanted>
  MovedClusters ClustersThat(const Wanted& wanted) const;
  // The clusters that may meet a plane which faces the direction between the two places.
  MovedClusters Facing(double from_m, double to_m) const;
  // The second sum of L at steps + 1 places from the one to the other, evenly.
  std::vector<double> EdgeLosses(double from_m, double to_m, int steps) const;

  const std::vector<PointCluster>& clusters_;
  const VoxelMap& map_;
  PlanesInstead instead_;
  SE3 T_world_lidar_;
  Vector6d direction_;
  double floor2_;
};

}  // namespace lamina
