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
//     sum_k  c_k min(n_k, max_cluster_weight) rho(e_k),    rho of core/geometry/robust_kernel.h,
//     its scale graduated from wide to narrow, c_k in [0, 1] of frontend/matching/line_of_sight.h
//     and smaller for young planes (ScanMatcherOptions::young_frames),
//
// minimised by Gauss-Newton over the tangent [rotation; translation] of core/geometry/se3.h. Where
// planes leave a direction open, rough leaves join with all three directions of their distribution
// (Magnusson's NDT, in the distribution-to-distribution form); those that one ring has drawn are
// no evidence (line_of_sight.h). Planes that the scan meets flatly (kFlatSine) take part only if,
// where the descent begins, the others leave a direction open by 0.4 of max_direction_sigma_m.
//
// Degeneracy (degeneracy.h). Along a direction that the residuals do not determine, the estimate is
// the mean of what they say and of the prediction, each by its information,
//
//     (f x_planes + p x_predicted) / (f + p),
//
// f being the information that counts and p that of the prediction: with f = 0 the pose stays on
// the prediction. The decision is made anew as the descent goes on, and what is reported is what
// its last steps did.
//
// Covariance. What the residuals scatter, not what the noise options promise: with H = sum w J'J,
// and H_s, G_s the shares of H and of the gradient sum w e J' that clusters in block s have,
//
//     H^-1 (sum_s C_s G_s (C_s G_s)') H^-1,    C_s = (I - H_s H^-1)^-1/2.
//
// Blocks are cubes of 4 m: clusters in one of them have errors in common (the ring that passes over
// several planes, the pose of the scan that made most of the planes there), which count once, and
// those of different blocks are taken for independent (cluster-robust covariance). C_s makes up for
// what fitting the pose has taken from the residuals of a block, the more the larger its share
// (CR2; Bell and McCaffrey 2002): in a room a few blocks determine it. Along what one block
// determines by more than half, fitting leaves hardly anything of its residuals as a whole; there
// the surfaces in it count as independent, if that is more. Motion within the scan that is not
// steady comes on top (sweep_acceleration.h). It is the error of the pose relative to the map
// around it; what the map has drifted by before is not in it.
//
// Votes of blocks. Where something near and dense moves along, most clusters agree on a pose that
// is wrong, and its covariance is small. With n_s the trace of what H_s knows of translation,
// 1/m^2, a block's vote is v_s = n_0 / (n_0 + n_s), and the blocks would have the pose a step
//
//     d = -(n_0/2 I + sum_s v_s H_s)^-1 sum_s v_s G_s,    n_0 = 1 / (5 cm)^2,
//
// away (BlockStep; translation alone), with a standard deviation by how v_s G_s scatter.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/geometry/degeneracy.h"
#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"
#include "core/map/voxel_map.h"
#include "core/options/options.h"
#include "frontend/matching/block_votes.h"
#include "frontend/matching/planes_instead.h"

namespace lamina {

struct ScanMatcherOptions {
  int max_iterations = 20;
  // Converged when a step is below both.
  double min_rotation_step_deg = 0.002;
  double min_translation_step_m = 0.0005;
  // A plane along the line of sight that fewer frames have seen is young: the arc that a sweep
  // draws across a corner looks like a plane, too, and moves along with the sensor. Its residuals
  // weigh s^2 / (s^2 + young_sigma_m^2) of what others do.
  int young_frames = 3;
  double young_sigma_m = 0.1;
  // Scale of the robust kernel, in standard deviations, at the first and from the last graduation
  // on.
  double kernel_start_sigma = 12.0;
  double kernel_end_sigma = 2.0;
  // Distance beyond which a plane is no match at all.
  double max_distance_m = 1.0;
  // A direction is degenerate where the clusters that face it leave it less certain than this, ...
  double max_direction_sigma_m = 0.05;
  // ... or are fewer: so few may all be wrong.
  int min_facing_clusters = 6;

  void Visit(OptionVisitor& v);
};
// The kernel as narrow from the first step on as it is at the last one.
ScanMatcherOptions WithNarrowKernel(ScanMatcherOptions options);

// Predicted pose of a scan, and its covariance in the tangent of core/geometry/se3.h.
struct PosePrediction {
  SE3 T_world_lidar;
  Matrix6d covariance = Matrix6d::Zero();

  // Information along a unit vector of the scaled tangent (degeneracy.h), 1/m^2.
  double Information(const Vector6d& direction) const;
};

// Standard deviations of the position, along the world's axis on which it is known worst, and of
// the turn, about the axis of the sensor that is known worst.
inline double SigmaM(const PosePrediction& prediction) {
  return std::sqrt(prediction.covariance.diagonal().tail<3>().maxCoeff());
}
inline double SigmaRad(const PosePrediction& prediction) {
  return std::sqrt(prediction.covariance.diagonal().head<3>().maxCoeff());
}

// A unit vector of the scaled tangent (degeneracy.h), and how well the pose is known along it.
struct KnownDirection {
  Vector6d direction = Vector6d::Unit(3);
  double sigma_m = 0.0;
};

struct MatchResult {
  // Fit above which planes speak for a pose: a wrong one has up to 0.65 anywhere in a street,
  // ground on ground and facade on facade, a right one 0.85 and more.
  static constexpr double kChanceFit = 0.5;
  // Least fit of a scan on the planes of the one just before. With few rings and among trees it is
  // 0.55 to 0.65 if both poses are right, and up to 0.53 if the times within the sweep are misread.
  static constexpr double kFollowingFit = 0.55;

  enum class Status {
    kConverged,
    kIterationLimit,  // usable
    kTooFewMatches,  // pose is the initial one, and nothing is known of it: covariance, worst sigma
                     // and degenerate directions are zero
  };
  Status status = Status::kTooFewMatches;
  SE3 T_world_lidar;
  int iterations = 0;
  int clusters = 0;
  int matched = 0;            // clusters that met a plane within max_distance_m
  double inlier_share = 0.0;  // sum of robust weights / number of clusters
  // Share of the clusters that met a plane, and of the kernel's weights among those, in [0, 1].
  double overlap() const { return clusters > 0 ? static_cast<double>(matched) / clusters : 0.0; }
  double fit() const { return matched > 0 ? inlier_share * clusters / matched : 0.0; }
  // Evidence for the pose: a place where much of the scan meets planes that it does not fit is
  // worse than one where less of it meets planes, and fits.
  double evidence() const { return inlier_share - kChanceFit * overlap(); }
  BlockStep block_step;         // with a covariance only
  double residual_rms_m = 0.0;  // robustly weighted distance to the planes
  // Covariance of the pose relative to the map, tangent order [rotation; translation] (rad^2, m^2);
  // along degenerate directions that of planes and prediction together.
  Matrix6d covariance = Matrix6d::Zero();
  // Largest standard deviation over all directions, from the residuals that face them: the
  // degeneracy signal. At most kUnknownSigmaM.
  static constexpr double kUnknownSigmaM = 100.0;
  double worst_sigma_m = 0.0;
  // A unit vector of the scaled tangent: where the residuals say least.
  Vector6d weakest_direction = Vector6d::Zero();
  // Number of degenerate directions, and those that are held (unit vectors of the scaled tangent,
  // the others zero), but for that of MatchKnown: bundle adjustment, which sees the scans that come
  // after, is not held to what one scan's planes and prediction said of it. For each the
  // information (1/m^2) that holds the result there against what planes only seem to say.
  int degenerate = 0;
  Matrix6d degenerate_directions = Matrix6d::Zero();
  Vector6d degenerate_information = Vector6d::Zero();
  // The prediction's part of the information: along the directions that are held (scaled tangent,
  // 1/m^2).
  Matrix6d prior_information = Matrix6d::Zero();

  // Marks the match degenerate for another reason than its planes.
  void MakeDegenerate() { degenerate = std::max(1, degenerate); }
  // The same, and records this direction (a unit vector of the scaled tangent) if none was yet. Its
  // degenerate_information stays zero: bundle adjustment does not hold it.
  void MakeDegenerate(const Vector6d& direction);
  // The pose may as well be at this tangent vector from here: adds that to the covariance, and
  // marks the direction to it degenerate.
  void MayBeElsewhere(const Vector6d& elsewhere);
};

// How much better one of two poses fits the map, in standard deviations of the sum over the
// clusters.
struct FitDifference {
  // Clusters that fit the plane around them at one pose and at the other miss it, or meet none, as
  // votes. Those that fit at both say nothing, however much better one fit is: the errors of a
  // sensor's beams fit best where it has not moved.
  double votes_sigmas = 0.0;
  // Mean over the clusters of what PlaneScore has for a fit beyond kChanceFit. What meets no plane
  // says nothing: poses may see more or less of what the map has.
  double evidence_sigmas = 0.0;
  double evidence = 0.0;
};

// Stateless; thread-safe while the map does not change. Same input, same bits, at any number
// of threads.
class ScanMatcher {
 public:
  // Throws OptionError.
  explicit ScanMatcher(const ScanMatcherOptions& options);

  const ScanMatcherOptions& options() const { return options_; }

  // Clusters in the LiDAR frame, deskewed to one instant. The descent starts at `initial`; the
  // prediction decides where planes do not.
  MatchResult Match(const std::vector<PointCluster>& clusters, const PosePrediction& prediction,
                    const SE3& initial, const VoxelMap& map) const {
    return Run(clusters, prediction, initial, nullptr, map, true);
  }
  MatchResult Match(const std::vector<PointCluster>& clusters, const PosePrediction& prediction,
                    const VoxelMap& map) const {
    return Match(clusters, prediction, prediction.T_world_lidar, map);
  }
  // The same without the covariance, which costs as much as a step or two.
  MatchResult MatchPose(const std::vector<PointCluster>& clusters, const PosePrediction& prediction,
                        const VoxelMap& map) const {
    return Run(clusters, prediction, prediction.T_world_lidar, nullptr, map, false);
  }
  // Matches near a pose that is known along one direction from elsewhere: the pose stays as it is
  // along that, and the nearest minimum along all others is found.
  MatchResult MatchKnown(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar,
                         const KnownDirection& known, const PosePrediction& prediction,
                         const VoxelMap& map) const;

  // Evidence that other planes, in the place of the map's surfaces, give along each column of
  // `directions` (orthonormal, scaled tangent), at that pose.
  DirectionEvidence EvidenceOf(const PlanesInstead& planes,
                               const std::vector<PointCluster>& clusters, const SE3& T_world_lidar,
                               const VoxelMap& map, const Matrix6d& directions) const;

  // How well the clusters lie on the map's planes at a pose: the mean over the clusters of
  // SightWeight * (GemanMcClureWeight((distance / scale_m)^2) - chance), a cluster without a plane
  // around it counting 0. Visits every `stride`-th cluster: cheap enough to compare hundreds of
  // poses.
  double Score(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar,
               const VoxelMap& map, double scale_m, std::size_t stride = 1,
               double chance = 0.0) const;

  FitDifference Compare(const std::vector<PointCluster>& clusters, const SE3& ours,
                        const SE3& theirs, const VoxelMap& map, double scale_m) const;
  // The same in standard deviations of the votes of blocks (PlaceVotes).
  double CompareBlocks(const std::vector<PointCluster>& clusters, const SE3& ours,
                       const SE3& theirs, const VoxelMap& map, double scale_m) const;

 private:
  MatchResult Run(const std::vector<PointCluster>& clusters, const PosePrediction& prediction,
                  const SE3& initial, const KnownDirection* known, const VoxelMap& map,
                  bool with_covariance) const;

  ScanMatcherOptions options_;
};

}  // namespace lamina
