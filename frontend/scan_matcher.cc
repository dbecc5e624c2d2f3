#include "frontend/scan_matcher.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "core/robust_kernel.h"

namespace lamina {
namespace {

// One linearisation of the cost: H step = -g.
struct NormalEquations {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  double weight = 0.0;     // sum of the weights (1/m^2)
  double robust = 0.0;     // sum of the kernel's weights in [0, 1]
  double residual2 = 0.0;  // sum of kernel weight * distance^2
  int matched = 0;
  int young = 0;  // those on young planes
  // Information along given directions that comes from clusters which clearly face them: all / on
  // planes that are not young.
  Vector6d facing = Vector6d::Zero(), facing_old = Vector6d::Zero();

  NormalEquations& operator+=(const NormalEquations& o) {
    H += o.H;
    g += o.g;
    weight += o.weight;
    robust += o.robust;
    residual2 += o.residual2;
    matched += o.matched;
    young += o.young;
    facing += o.facing;
    facing_old += o.facing_old;
    return *this;
  }
};

// Tangent vectors in one unit, metres: a rotation counts by what it moves at kRotationArmM. The
// same division takes a step back to radians and a gradient, by the chain rule, to metres.
Vector6d DividedByArm(const Vector6d& v) {
  Vector6d divided = v;
  divided.head<3>() /= MatchResult::kRotationArmM;
  return divided;
}
Matrix6d DividedByArm(const Matrix6d& m) {
  Matrix6d divided = m;
  divided.topRows<3>() /= MatchResult::kRotationArmM;
  divided.leftCols<3>() /= MatchResult::kRotationArmM;
  return divided;
}

struct Directions {
  Matrix6d columns = Matrix6d::Zero();  // scaled tangent vectors, orthonormal
  int count = 0;
};

// Collects the residuals of all clusters at one pose.
class Lineariser {
 public:
  Lineariser(const ScanMatcherOptions& options, const VoxelMap& map,
             const std::vector<PointCluster>& clusters)
      : options_(options), map_(map), clusters_(clusters), surfaces_(clusters.size()) {}

  const VoxelMap& map() const { return map_; }

  // Rough structure takes part as well.
  bool use_rough = false;
  // If not null, `facing` is gathered for these directions.
  const Directions* watched = nullptr;

  NormalEquations At(const SE3& T, double kernel_sigma) {
    const Eigen::Matrix3d R = T.R();
    Associate(T, R);
    NormalEquations total =
        ParallelSum(clusters_.size(), 1024, NormalEquations(), [&](size_t begin, size_t end) {
          NormalEquations sum;
          for (size_t i = begin; i < end; ++i) AddCluster(i, R, T.t, kernel_sigma, &sum);
          return sum;
        });
    total.H = total.H.selfadjointView<Eigen::Lower>();
    return total;
  }

 private:
  // Looks up the surface around each cluster, unless the pose is still so near the one of the last
  // look-up that a cluster at kFarM has moved by less than a small part of a leaf.
  void Associate(const SE3& T, const Eigen::Matrix3d& R) {
    constexpr double kFarM = 30.0;
    const double near_m = 0.05 * map_.options().LeafSize();
    if (associated_ &&
        (T.t - associated_at_.t).norm() + kFarM * RotationAngle(associated_at_, T) < near_m) {
      return;
    }
    associated_ = true;
    associated_at_ = T;
    ParallelChunks(clusters_.size(), 1024, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        const Eigen::Vector3d p = R * clusters_[i].mean + T.t;
        surfaces_[i] = map_.CanHold(p) ? map_.FindSurface(p) : VoxelMap::kNoNode;
      }
    });
  }

  void AddCluster(size_t i, const Eigen::Matrix3d& R, const Eigen::Vector3d& t, double kernel_sigma,
                  NormalEquations* sum) const {
    if (surfaces_[i] == VoxelMap::kNoNode) return;
    const PointCluster& cluster = clusters_[i];
    const Surface& surface = map_.surface(surfaces_[i]);
    if (surface.kind == Surface::Kind::kPlane) {
      AddPlane(cluster, R, R * cluster.mean + t, surface, kernel_sigma, sum);
    } else if (use_rough && surface.kind == Surface::Kind::kRough) {
      AddRough(cluster, R, R * cluster.mean + t, surfaces_[i], kernel_sigma, sum);
    }
  }

  void AddPlane(const PointCluster& cluster, const Eigen::Matrix3d& R, const Eigen::Vector3d& p,
                const Surface& surface, double kernel_sigma, NormalEquations* sum) const {
    const Eigen::Vector3d normal = surface.normal.cast<double>();
    const double distance = normal.dot(p - surface.mean);
    if (std::abs(distance) > options_.max_distance_m) return;
    const Eigen::Vector3d normal_lidar = R.transpose() * normal;
    const double spread = normal_lidar.dot(cluster.scatter * normal_lidar) / cluster.count;
    const double variance = options_.noise_floor_m * options_.noise_floor_m +
                            static_cast<double>(surface.variance) + spread;
    const double e2 = distance * distance / (variance * kernel_sigma * kernel_sigma);
    const double robust = GemanMcClureWeight(e2);
    // The arc that one sweep draws across a corner looks like a plane, too, and moves along with
    // the sensor.
    const bool young = surface.frames < options_.young_frames;
    const double doubt = young ? options_.young_sigma_m * options_.young_sigma_m : 0.0;
    const double w =
        robust * std::min(cluster.count, options_.max_cluster_weight) / (variance + doubt);
    AddDirection(normal, normal_lidar, cluster.mean, distance, w, young, sum);
    sum->young += young ? 1 : 0;
    sum->robust += robust;
    sum->residual2 += robust * distance * distance;
    ++sum->matched;
  }

  // A pole or an edge has no plane, but is narrow across: every narrow axis of the joint
  // distribution of cluster and leaf holds its direction. Wide axes end at the voxel's faces, not
  // at anything real, and say nothing.
  void AddRough(const PointCluster& cluster, const Eigen::Matrix3d& R, const Eigen::Vector3d& p,
                VoxelMap::NodeId leaf, double kernel_sigma, NormalEquations* sum) const {
    constexpr double kNarrow = 0.15;  // of a leaf; a leaf filled evenly has 0.29
    const PointCluster map_cluster = map_.Aggregate(leaf);
    Symmetric3 joint = map_cluster.Covariance();
    joint += cluster.Covariance().Rotated(R);
    const Eigen3 eigen = EigenDecompose(joint);
    const double floor2 = options_.noise_floor_m * options_.noise_floor_m;
    const double widest2 = std::pow(kNarrow * map_.options().LeafSize(), 2);
    for (int i = 0; i < 3; ++i) {
      if (eigen.l(i) > widest2) continue;
      const Eigen::Vector3d axis = eigen.u.col(i);
      const double distance = axis.dot(p - map_cluster.mean);
      const double variance = floor2 + eigen.l(i);
      const double e2 = distance * distance / (variance * kernel_sigma * kernel_sigma);
      const double w =
          GemanMcClureWeight(e2) * std::min(cluster.count, options_.max_cluster_weight) / variance;
      const bool young = map_.surface(leaf).frames < options_.young_frames;
      AddDirection(axis, R.transpose() * axis, cluster.mean, distance, w, young, sum);
    }
  }

  // Adds a residual `distance` along the unit direction `normal` (world), of weight w.
  void AddDirection(const Eigen::Vector3d& normal, const Eigen::Vector3d& normal_lidar,
                    const Eigen::Vector3d& mu, double distance, double w, bool young,
                    NormalEquations* sum) const {
    Vector6d j;
    j << mu.cross(normal_lidar), normal;
    for (int c = 0; c < 6; ++c) {
      const double wj = w * j(c);
      for (int r = c; r < 6; ++r) sum->H(r, c) += wj * j(r);
      sum->g(c) += wj * distance;
    }
    sum->weight += w;
    if (watched == nullptr) return;
    // Errors of the normals leak a little information into every direction, and a thousand times a
    // little looks like much. An error of the normal by an angle turns j by that angle times
    // (range, 1) in (rotation, translation): what an error of 6 degrees could feign does not count.
    constexpr double kNormalError = 0.1;
    constexpr double kArmM = MatchResult::kRotationArmM;
    const Vector6d scaled = DividedByArm(j);
    const double relative_range2 = mu.squaredNorm() / (kArmM * kArmM);
    for (int k = 0; k < watched->count; ++k) {
      const auto v = watched->columns.col(k);
      const double along = v.dot(scaled);
      const double leak2 =
          kNormalError * kNormalError *
          (relative_range2 * v.head<3>().squaredNorm() + v.tail<3>().squaredNorm());
      const double information = w * std::max(0.0, along * along - leak2);
      sum->facing(k) += information;
      if (!young) sum->facing_old(k) += information;
    }
  }

  const ScanMatcherOptions& options_;
  const VoxelMap& map_;
  const std::vector<PointCluster>& clusters_;
  std::vector<VoxelMap::NodeId> surfaces_;
  bool associated_ = false;
  SE3 associated_at_;
};

constexpr int kMinMatches = 10;
constexpr double kLeastInformation = 1e-4;  // 1/m^2: nothing is known worse than to 100 m

// Gauss-Newton from `initial`, keeping out of the directions `held`. False if there are too few
// matches.
bool Descend(Lineariser& lineariser, const ScanMatcherOptions& options, const SE3& initial,
             const Directions& held, MatchResult* result, NormalEquations* eq) {
  result->T_world_lidar = initial;
  result->status = MatchResult::Status::kIterationLimit;
  double kernel = options.kernel_start_sigma;
  const Matrix6d keep = Matrix6d::Identity() - held.columns * held.columns.transpose();
  for (int i = 0; i < options.max_iterations; ++i) {
    *eq = lineariser.At(result->T_world_lidar, kernel);
    ++result->iterations;
    if (eq->matched < kMinMatches) return false;
    const Matrix6d Hs = keep * DividedByArm(eq->H) * keep;
    // A whisper of stiffness keeps the factorisation alive where nothing is measured.
    const Matrix6d damped = Hs + 1e-9 * eq->weight * Matrix6d::Identity();
    const Vector6d gs = keep * DividedByArm(eq->g);
    Vector6d step = -(keep * damped.ldlt().solve(gs));
    if (!step.allFinite()) return false;
    // Associations are good for about a voxel: a longer step is a leap in the dark.
    step *= std::min(1.0, 0.5 * lineariser.map().options().root_size_m / step.norm());
    step = DividedByArm(step);
    result->T_world_lidar = Retract(result->T_world_lidar, step);
    const bool narrow = kernel <= options.kernel_end_sigma;
    kernel = std::max(options.kernel_end_sigma, 0.5 * kernel);
    if (narrow && step.head<3>().norm() < options.min_rotation_step_deg * M_PI / 180.0 &&
        step.tail<3>().norm() < options.min_translation_step_m) {
      result->status = MatchResult::Status::kConverged;
      break;
    }
  }
  return true;
}

// What is known of the pose, as long as nothing is.
void ForgetInformation(MatchResult* result) {
  const MatchResult fresh;
  result->covariance = fresh.covariance;
  result->worst_sigma_m = fresh.worst_sigma_m;
  result->degenerate = fresh.degenerate;
  result->degenerate_directions = fresh.degenerate_directions;
}

// Directions in which the clusters that face them leave the pose uncertain; also fills the result's
// information. Evaluated at the result's pose. False if there are too few matches to tell: then
// there is no information, and no direction is named.
bool FindUnobservable(Lineariser& lineariser, const ScanMatcherOptions& options,
                      double kernel_sigma, MatchResult* result, Directions* held) {
  ForgetInformation(result);
  *held = Directions();
  NormalEquations eq = lineariser.At(result->T_world_lidar, kernel_sigma);
  if (eq.matched < kMinMatches) return false;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(DividedByArm(eq.H));
  const Directions all = {solver.eigenvectors(), 6};
  // No leak makes up such a share of the information: the second pass is for doubtful scans.
  constexpr double kClearShare = 0.02;
  Vector6d facing = solver.eigenvalues();
  if (facing(0) < kClearShare * eq.weight) {
    lineariser.watched = &all;
    eq = lineariser.At(result->T_world_lidar, kernel_sigma);
    lineariser.watched = nullptr;
    // Young planes are heard where there is little else, as on the first scans.
    constexpr double kMostlyYoung = 0.6;
    facing = eq.young > kMostlyYoung * eq.matched ? eq.facing : eq.facing_old;
  }
  Matrix6d covariance = Matrix6d::Zero();
  for (int k = 0; k < 6; ++k) {
    const Vector6d v = all.columns.col(k);
    const double sigma = 1.0 / std::sqrt(std::max(facing(k), kLeastInformation));
    result->worst_sigma_m = std::max(result->worst_sigma_m, sigma);
    const bool open =
        sigma > options.max_direction_sigma_m || facing(k) < options.min_facing_share * eq.weight;
    if (open) held->columns.col(held->count++) = v;
    covariance +=
        v * v.transpose() / std::max(open ? facing(k) : solver.eigenvalues()(k), kLeastInformation);
  }
  result->covariance = DividedByArm(covariance);
  result->degenerate = held->count;
  result->degenerate_directions = held->columns;
  return true;
}

}  // namespace

void ScanMatcherOptions::Visit(OptionVisitor& v) {
  v.Integer("max_iterations", &max_iterations, 1, 1000);
  v.Number("min_rotation_step_deg", &min_rotation_step_deg, 1e-9, 10.0);
  v.Number("min_translation_step_m", &min_translation_step_m, 1e-9, 10.0);
  v.Number("noise_floor_m", &noise_floor_m, 1e-4, 1.0);
  v.Integer("young_frames", &young_frames, 1, 1000);
  v.Number("young_sigma_m", &young_sigma_m, 0.0, 10.0);
  v.Number("max_cluster_weight", &max_cluster_weight, 1.0, 1e6);
  v.Number("kernel_start_sigma", &kernel_start_sigma, 0.1, 1e3);
  v.Number("kernel_end_sigma", &kernel_end_sigma, 0.1, 1e3);
  v.Number("max_distance_m", &max_distance_m, 0.01, 100.0);
  v.Number("max_direction_sigma_m", &max_direction_sigma_m, 1e-4, 1e6);
  v.Number("min_facing_share", &min_facing_share, 0.0, 0.3);
}

ScanMatcher::ScanMatcher(const ScanMatcherOptions& options) : options_(options) {
  CheckOptions(options, "frontend.matcher");
}

MatchResult ScanMatcher::Match(const std::vector<PointCluster>& clusters, const SE3& initial,
                               const VoxelMap& map) const {
  MatchResult result;
  result.clusters = static_cast<int>(clusters.size());
  result.T_world_lidar = initial;
  Lineariser lineariser(options_, map, clusters);
  NormalEquations eq;
  // What planes leave open already at the prediction is given to rough structure; what is open even
  // then is held from the start, or the first steps would slide along it, out of the map.
  Directions held, after;
  FindUnobservable(lineariser, options_, options_.kernel_start_sigma, &result, &held);
  if (held.count > 0) {
    lineariser.use_rough = true;
    FindUnobservable(lineariser, options_, options_.kernel_start_sigma, &result, &held);
  }
  bool enough = Descend(lineariser, options_, initial, held, &result, &eq) &&
                FindUnobservable(lineariser, options_, options_.kernel_end_sigma, &result, &after);
  // Outliers may have posed as structure before the kernel had narrowed.
  if (enough && after.count > held.count) {
    lineariser.use_rough = true;
    enough = Descend(lineariser, options_, initial, after, &result, &eq);
  }
  if (!enough) {
    ForgetInformation(&result);
    result.status = MatchResult::Status::kTooFewMatches;
    result.T_world_lidar = initial;
  }
  result.matched = eq.matched;
  result.inlier_share = eq.robust / static_cast<double>(std::max<std::size_t>(1, clusters.size()));
  result.residual_rms_m = std::sqrt(eq.residual2 / std::max(eq.robust, 1e-9));
  return result;
}

double ScanMatcher::Score(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar,
                          const VoxelMap& map, double scale_m, std::size_t stride) const {
  const Eigen::Matrix3d R = T_world_lidar.R();
  const double inverse2 = 1.0 / (scale_m * scale_m);
  double sum = 0.0;
  std::size_t visited = 0;
  for (std::size_t i = 0; i < clusters.size(); i += stride, ++visited) {
    const Eigen::Vector3d p = R * clusters[i].mean + T_world_lidar.t;
    if (!map.CanHold(p)) continue;
    const VoxelMap::NodeId id = map.FindSurface(p);
    if (id == VoxelMap::kNoNode) continue;
    const Surface& surface = map.surface(id);
    if (surface.kind != Surface::Kind::kPlane) continue;
    const double distance = surface.normal.cast<double>().dot(p - surface.mean);
    sum += GemanMcClureWeight(distance * distance * inverse2);
  }
  return visited == 0 ? 0.0 : sum / static_cast<double>(visited);
}

}  // namespace lamina
