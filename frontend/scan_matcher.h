// Scan-to-map matching without nearest-neighbour search: a hash look-up for each cluster.
//
// For every cluster (n, mu, Sigma) of the scan, moved to the pose (R, t), the map gives the
// coarsest plane (normal nu, point m, squared thickness v) around R mu + t, and
//
//     e = nu . (R mu + t - m) / s,    s^2 = noise_floor^2 + v + nu' R Sigma R' nu
//
// is its distance in standard deviations: a cluster that is not flat along the plane it meets
// (a bush before a wall) weighs little by itself. The cost is
//
//     sum_k  min(n_k, max_cluster_weight) rho(e_k),    rho of core/robust_kernel.h, its scale
//     graduated from wide to narrow,
//
// minimised by Gauss-Newton over the tangent [rotation; translation] of core/se3.h. Where planes
// leave a direction open, rough leaves join with all three directions of their distribution
// (Magnusson's NDT, in the distribution-to-distribution form).
//
// Degeneracy. Rotations count by what they move at a distance of 3 m, so that tangent vectors are
// in metres. Along an eigenvector v of H = sum w J'J, the information that counts is sum w max(0,
// (J v)^2 - leak^2), where leak is what an error of 0.1 rad of the plane's normal could feign;
// where 1 / sqrt(that) exceeds `max_direction_sigma_m` the direction is *unobservable*: the pose
// stays on the prediction there, and the result says so.
#pragma once

#include <vector>

#include "core/options.h"
#include "core/point_cluster.h"
#include "core/se3.h"
#include "core/voxel_map.h"

namespace lamina {

struct ScanMatcherOptions {
  int max_iterations = 20;
  // Converged when a step is below both.
  double min_rotation_step_deg = 0.002;
  double min_translation_step_m = 0.0005;
  // Standard deviation that no plane is believed to be better than.
  double noise_floor_m = 0.02;
  // A plane that fewer frames have seen is young, and this is added to its variance, squared: the
  // arc that a sweep draws across a corner looks like a plane, too, and moves along with the
  // sensor.
  int young_frames = 3;
  double young_sigma_m = 0.1;
  // Points that a cluster weighs at most: dense surfaces nearby must not outvote the far ones.
  double max_cluster_weight = 4.0;
  // Scale of the robust kernel, in standard deviations, at the first and from the last graduation
  // on.
  double kernel_start_sigma = 12.0;
  double kernel_end_sigma = 2.0;
  // Distance beyond which a plane is no match at all.
  double max_distance_m = 1.0;
  // Standard deviation along a direction beyond which it counts as unobservable.
  double max_direction_sigma_m = 0.05;
  // ... and share of all information below which it does, too: few planes that face it may all be
  // wrong.
  double min_facing_share = 0.001;

  void Visit(OptionVisitor& v);
};

struct MatchResult {
  enum class Status {
    kConverged,
    kIterationLimit,  // usable
    kTooFewMatches,  // pose is the initial one, and nothing is known of it: covariance, worst sigma
                     // and degenerate directions are zero
  };
  // Rotations count by what they move at this distance, in metres.
  static constexpr double kRotationArmM = 3.0;

  Status status = Status::kTooFewMatches;
  SE3 T_world_lidar;
  int iterations = 0;
  int clusters = 0;
  int matched = 0;              // clusters that met a plane within max_distance_m
  double inlier_share = 0.0;    // sum of robust weights / number of clusters
  double residual_rms_m = 0.0;  // robustly weighted distance to the planes
  // Covariance of the pose, tangent order [rotation; translation] (rad^2, m^2); in unobservable
  // directions that of the prediction stands in its place (large).
  Matrix6d covariance = Matrix6d::Zero();
  // Largest standard deviation over all directions, from the residuals that face them: the
  // degeneracy signal.
  double worst_sigma_m = 0.0;
  // Number of directions held at the prediction, and these directions (the first `degenerate`
  // columns, the others zero): unit tangent vectors in which rotations count at kRotationArmM.
  int degenerate = 0;
  Matrix6d degenerate_directions = Matrix6d::Zero();
};

// Stateless; thread-safe as long as nobody writes to the map. Same input, same bits, at any number
// of threads.
class ScanMatcher {
 public:
  // Throws OptionError.
  explicit ScanMatcher(const ScanMatcherOptions& options);

  // Clusters in the LiDAR frame, deskewed to one instant.
  MatchResult Match(const std::vector<PointCluster>& clusters, const SE3& initial,
                    const VoxelMap& map) const;

  // How well the clusters lie on the map's planes at a pose, in [0, 1]: the mean over the clusters
  // of GemanMcClureWeight((distance / scale_m)^2), a cluster without a plane around it counting 0.
  // Visits every `stride`-th cluster: cheap enough to compare hundreds of poses.
  double Score(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar,
               const VoxelMap& map, double scale_m, std::size_t stride = 1) const;

 private:
  ScanMatcherOptions options_;
};

}  // namespace lamina
