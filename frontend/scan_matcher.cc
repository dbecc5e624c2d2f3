#include "frontend/scan_matcher.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "core/parallel.h"

namespace lamina {
namespace {

// One linearisation of the cost: H step = -g.
struct NormalEquations {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  double weight = 0.0;     // sum of the weights (1/m^2)
  double robust = 0.0;     // sum of the kernel's weights in [0, 1]
  double residual2 = 0.0;  // sum of kernel weight * distance^2
  double range = 0.0;      // sum of weight * range^2
  int matched = 0;

  NormalEquations& operator+=(const NormalEquations& o) {
    H += o.H;
    g += o.g;
    weight += o.weight;
    robust += o.robust;
    residual2 += o.residual2;
    range += o.range;
    matched += o.matched;
    return *this;
  }
};

// Adds a residual `distance` along the unit direction `normal` (world), of weight w.
inline void AddDirection(const Eigen::Vector3d& normal, const Eigen::Vector3d& normal_lidar,
                         const Eigen::Vector3d& mu, double distance, double w,
                         NormalEquations* sum) {
  Vector6d j;
  j << mu.cross(normal_lidar), normal;
  for (int c = 0; c < 6; ++c) {
    const double wj = w * j(c);
    for (int r = c; r < 6; ++r) sum->H(r, c) += wj * j(r);
    sum->g(c) += wj * distance;
  }
  sum->weight += w;
  sum->range += w * mu.squaredNorm();
}

struct Linearisation {
  const ScanMatcherOptions& options;
  const VoxelMap& map;
  const std::vector<PointCluster>& clusters;

  NormalEquations At(const SE3& T, double kernel_sigma) const {
    const Eigen::Matrix3d R = T.R();
    NormalEquations total =
        ParallelSum(clusters.size(), 1024, NormalEquations(), [&](size_t begin, size_t end) {
          NormalEquations sum;
          for (size_t i = begin; i < end; ++i) AddCluster(clusters[i], R, T.t, kernel_sigma, &sum);
          return sum;
        });
    total.H = total.H.selfadjointView<Eigen::Lower>();
    return total;
  }

  void AddCluster(const PointCluster& cluster, const Eigen::Matrix3d& R, const Eigen::Vector3d& t,
                  double kernel_sigma, NormalEquations* sum) const {
    const Eigen::Vector3d p = R * cluster.mean + t;
    if (!map.CanHold(p)) return;
    const VoxelMap::NodeId id = map.FindSurface(p);
    if (id == VoxelMap::kNoNode) return;
    const Surface& surface = map.surface(id);
    if (surface.kind != Surface::Kind::kPlane) return;
    const Eigen::Vector3d normal = surface.normal.cast<double>();
    const double distance = normal.dot(p - surface.mean);
    if (std::abs(distance) > options.max_distance_m) return;
    const Eigen::Vector3d normal_lidar = R.transpose() * normal;
    const double spread = normal_lidar.dot(cluster.scatter * normal_lidar) / cluster.count;
    const double variance = options.noise_floor_m * options.noise_floor_m +
                            static_cast<double>(surface.variance) + spread;
    const double e2 = distance * distance / (variance * kernel_sigma * kernel_sigma);
    const double robust = 1.0 / ((1.0 + e2) * (1.0 + e2));
    const double w = robust * std::min(cluster.count, options.max_cluster_weight) / variance;
    AddDirection(normal, normal_lidar, cluster.mean, distance, w, sum);
    sum->robust += robust;
    sum->residual2 += robust * distance * distance;
    ++sum->matched;
  }
};

}  // namespace

void ScanMatcherOptions::Visit(OptionVisitor& v) {
  v.Integer("max_iterations", &max_iterations, 1, 1000);
  v.Number("min_rotation_step_deg", &min_rotation_step_deg, 1e-9, 10.0);
  v.Number("min_translation_step_m", &min_translation_step_m, 1e-9, 10.0);
  v.Number("noise_floor_m", &noise_floor_m, 1e-4, 1.0);
  v.Number("max_cluster_weight", &max_cluster_weight, 1.0, 1e6);
  v.Number("kernel_start_sigma", &kernel_start_sigma, 0.1, 1e3);
  v.Number("kernel_end_sigma", &kernel_end_sigma, 0.1, 1e3);
  v.Number("max_distance_m", &max_distance_m, 0.01, 100.0);
  v.Number("min_information_share", &min_information_share, 0.0, 0.3);
}

ScanMatcher::ScanMatcher(const ScanMatcherOptions& options) : options_(options) {
  CheckOptions(options, "frontend.matcher");
}

MatchResult ScanMatcher::Match(const std::vector<PointCluster>& clusters, const SE3& initial,
                               const VoxelMap& map) const {
  constexpr int kMinMatches = 10;
  const Linearisation linearisation{options_, map, clusters};
  MatchResult result;
  result.T_world_lidar = initial;
  result.clusters = static_cast<int>(clusters.size());
  SE3 T = initial;
  double kernel = options_.kernel_start_sigma;
  NormalEquations eq;
  for (int i = 0; i < options_.max_iterations; ++i) {
    eq = linearisation.At(T, kernel);
    result.iterations = i + 1;
    if (eq.matched < kMinMatches) return result;
    const double scale = std::sqrt(eq.range / eq.weight);
    Vector6d scaling;
    scaling << Eigen::Vector3d::Constant(1.0 / scale), Eigen::Vector3d::Ones();
    const Matrix6d Hs = scaling.asDiagonal() * eq.H * scaling.asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(Hs);
    Vector6d step = Vector6d::Zero();
    const Vector6d gs = scaling.asDiagonal() * eq.g;
    result.degenerate = 0;
    result.min_information_share = solver.eigenvalues()(0) / eq.weight;
    Matrix6d cov = Matrix6d::Zero();
    for (int k = 0; k < 6; ++k) {
      const Vector6d v = solver.eigenvectors().col(k);
      const double l = solver.eigenvalues()(k);
      if (l < options_.min_information_share * eq.weight) {
        result.degenerate_directions.col(result.degenerate++) = v;
        cov += v * v.transpose();
        continue;
      }
      step -= v * (v.dot(gs) / l);
      cov += v * v.transpose() / l;
    }
    result.covariance = scaling.asDiagonal() * cov * scaling.asDiagonal();
    step = scaling.asDiagonal() * step;
    T = Retract(T, step);
    const bool narrow = kernel <= options_.kernel_end_sigma;
    kernel = std::max(options_.kernel_end_sigma, 0.5 * kernel);
    if (narrow && step.head<3>().norm() < options_.min_rotation_step_deg * M_PI / 180.0 &&
        step.tail<3>().norm() < options_.min_translation_step_m) {
      result.status = MatchResult::Status::kConverged;
      break;
    }
  }
  if (result.status != MatchResult::Status::kConverged)
    result.status = MatchResult::Status::kIterationLimit;
  result.T_world_lidar = T;
  result.matched = eq.matched;
  result.inlier_share = eq.robust / static_cast<double>(clusters.size());
  result.residual_rms_m = std::sqrt(eq.residual2 / std::max(eq.robust, 1e-9));
  return result;
}

}  // namespace lamina
