#include "frontend/pairwise/voxelized_gicp.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "core/base/angle.h"
#include "core/base/parallel.h"
#include "core/map/voxel_key.h"

namespace lamina {
namespace {

constexpr double kMaxVoxelWeight = 10.0;
constexpr double kFewestPoints = 4.0;

// A hash of point clusters.
struct ClusterGrid {
  double inverse_m;
  VoxelIndex index;
  std::vector<PointCluster> clusters;

  ClusterGrid(const std::vector<Eigen::Vector3f>& points, double voxel_m)
      : inverse_m(1.0 / voxel_m), index(points.size() / 8) {
    for (const Eigen::Vector3f& point : points) {
      const Eigen::Vector3d p = point.cast<double>();
      if (!IsVoxelKeyInRange(p, inverse_m)) continue;
      index.Gather(VoxelKeyOf(p, inverse_m), &clusters).AddPoint(p);
    }
  }

  // Null where there is none.
  template <typename T>
  const T* At(const Eigen::Vector3d& p, const std::vector<T>& of_voxels) const {
    if (!IsVoxelKeyInRange(p, inverse_m)) return nullptr;
    const std::int32_t at = index.Find(VoxelKeyOf(p, inverse_m));
    return at == VoxelIndex::kNone ? nullptr : &of_voxels[static_cast<std::size_t>(at)];
  }
};

// A voxel of the target.
struct Distribution {
  double weight = 0.0;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

std::vector<Distribution> Distributions(const PairwiseCloud& cloud, const ClusterGrid& grid) {
  std::vector<Distribution> out(grid.clusters.size());
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    const Eigen::Vector3d p = cloud.points[i].cast<double>();
    const Distribution* found = grid.At(p, out);
    if (found == nullptr) continue;
    Distribution& d = out[static_cast<std::size_t>(found - out.data())];
    d.weight += 1.0;
    d.mean += p;
    d.covariance += cloud.covariances[i].Dense();
  }
  for (Distribution& d : out) {
    if (d.weight == 0.0) continue;
    d.mean /= d.weight;
    d.covariance /= d.weight;
    d.weight = std::min(d.weight, kMaxVoxelWeight);
  }
  return out;
}

struct NormalEquations {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  double matched = 0.0;

  NormalEquations& operator+=(const NormalEquations& o) {
    H += o.H, g += o.g, matched += o.matched;
    return *this;
  }
};

class VoxelizedGicp final : public PairwiseMethod {
 public:
  explicit VoxelizedGicp(const PairwiseOptions& options) : options_(options) {}

  void Prepare(PairwiseCloud* cloud) const override {
    const ClusterGrid grid(cloud->points, options_.vgicp_voxel_m);
    std::vector<Symmetric3> of_voxels;
    for (const PointCluster& cluster : grid.clusters) {
      Symmetric3 c{1.0, 0.0, 0.0, 1.0, 0.0, 1.0};
      if (cluster.count >= kFewestPoints) c.AddOuter(1e-3 - 1.0, cluster.EigenPairs().u.col(2));
      of_voxels.push_back(c);
    }
    cloud->covariances.assign(cloud->points.size(), {1.0, 0.0, 0.0, 1.0, 0.0, 1.0});
    for (std::size_t i = 0; i < cloud->points.size(); ++i) {
      const Symmetric3* c = grid.At(cloud->points[i].cast<double>(), of_voxels);
      if (c != nullptr) cloud->covariances[i] = *c;
    }
  }

  PairwiseResult Register(const PairwiseCloud& source, const PairwiseCloud& target,
                          const SE3& initial) const override {
    PairwiseResult result;
    result.T_target_source = initial;
    // Large voxels first: their reach is the farther.
    for (const double voxel_m : {2.0 * options_.vgicp_voxel_m, options_.vgicp_voxel_m}) {
      const ClusterGrid grid(target.points, voxel_m);
      const std::vector<Distribution> distributions = Distributions(target, grid);
      Descend(source, grid, distributions, &result);
      if (!result.good) return result;
    }
    return result;
  }

 private:
  void Descend(const PairwiseCloud& source, const ClusterGrid& grid,
               const std::vector<Distribution>& distributions, PairwiseResult* result) const {
    result->good = false;
    SE3& T = result->T_target_source;
    for (int i = 0; i < options_.max_iterations; ++i, ++result->iterations) {
      const NormalEquations sum = Linearise(source, grid, distributions, T);
      if (sum.matched < options_.min_overlap * static_cast<double>(source.points.size())) {
        result->reason = "too few points meet a voxel of the other scan";
        return;
      }
      const Vector6d step = -sum.H.ldlt().solve(sum.g);
      if (!step.allFinite()) {
        result->reason = "the normal equations are singular";
        return;
      }
      T = Retract(T, step);
      if (step.head<3>().norm() < Radians(options_.min_rotation_step_deg) &&
          step.tail<3>().norm() < options_.min_translation_step_m) {
        break;
      }
    }
    result->good = true;
  }

  static NormalEquations Linearise(const PairwiseCloud& source, const ClusterGrid& grid,
                                   const std::vector<Distribution>& distributions, const SE3& T) {
    const Eigen::Matrix3d R = T.R();
    const auto body = [&](std::size_t begin, std::size_t end) {
      NormalEquations sum;
      for (std::size_t i = begin; i < end; ++i) {
        const Eigen::Vector3d p = source.points[i].cast<double>();
        const Eigen::Vector3d q = R * p + T.t;
        const Distribution* v = grid.At(q, distributions);
        if (v == nullptr) continue;
        const Eigen::Matrix3d information =
            v->weight * (v->covariance + source.covariances[i].Rotated(R).Dense()).inverse();
        const Eigen::Vector3d e = q - v->mean;
        Eigen::Matrix<double, 3, 6> J;
        J << -R * Hat(p), Eigen::Matrix3d::Identity();
        const Eigen::Matrix<double, 6, 3> JW = J.transpose() * information;
        sum.H.noalias() += JW * J;
        sum.g.noalias() += JW * e;
        sum.matched += 1.0;
      }
      return sum;
    };
    return ParallelSum(source.points.size(), 1024, NormalEquations(), body);
  }

  PairwiseOptions options_;
};

}  // namespace

std::unique_ptr<PairwiseMethod> MakeVoxelizedGicp(const PairwiseOptions& options) {
  return std::make_unique<VoxelizedGicp>(options);
}

}  // namespace lamina
