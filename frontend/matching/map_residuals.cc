#include "frontend/matching/map_residuals.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>

#include "core/base/median.h"
#include "core/base/parallel.h"
#include "core/geometry/robust_kernel.h"
#include "core/map/voxel_key.h"
#include "frontend/matching/line_of_sight.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {

NormalEquations& NormalEquations::operator+=(const NormalEquations& o) {
  H += o.H;
  g += o.g;
  weight += o.weight;
  robust += o.robust;
  residual2 += o.residual2;
  matched += o.matched;
  matched_old += o.matched_old;
  all += o.all;
  old += o.old;
  return *this;
}

NormalEquations MapResiduals::At(const SE3& T, double kernel_sigma, const Matrix6d* watched) {
  const Eigen::Matrix3d R = T.R();
  Associate(T, R);
  watching_ = watched != nullptr;
  NormalEquations zero;
  if (watching_) zero.all.directions = zero.old.directions = *watched;
  NormalEquations total =
      ParallelSum(clusters_.size(), 1024, zero, [&](std::size_t begin, std::size_t end) {
        NormalEquations sum = zero;
        for (std::size_t i = begin; i < end; ++i) AddCluster(i, R, T.t, kernel_sigma, &sum);
        return sum;
      });
  // Rounding differs across the diagonal.
  total.H = total.H.selfadjointView<Eigen::Upper>();
  return total;
}

DirectionEvidence MapResiduals::EvidenceOfOlder(const SE3& T, double kernel_sigma,
                                                const Matrix6d& directions,
                                                std::int64_t before_frame) {
  const Eigen::Matrix3d R = T.R();
  Associate(T, R);
  watching_ = true;
  NormalEquations sum;
  sum.all.directions = sum.old.directions = directions;
  for (std::size_t i = 0; i < clusters_.size(); ++i) {
    if (planes_[i] == nullptr || map_.FirstAdded(surfaces_[i]) >= before_frame) continue;
    AddCluster(i, R, T.t, kernel_sigma, &sum);
  }
  return sum.all;
}

VoxelKey MapResiduals::BlockAround(const Eigen::Vector3d& p) {
  constexpr double kTogetherM = 4.0;
  return VoxelKeyOf(p, 1.0 / kTogetherM);
}

std::vector<MapResiduals::Block> MapResiduals::Blocks(const SE3& T, double kernel_sigma) {
  const Eigen::Matrix3d R = T.R();
  Associate(T, R);
  watching_ = false;
  VoxelIndex index(256);
  std::vector<Block> blocks;
  NormalEquations one;
  for (std::size_t i = 0; i < clusters_.size(); ++i) {
    if (surfaces_[i] == VoxelMap::kNoNode) continue;
    one.H.setZero();
    one.g.setZero();
    one.weight = 0.0;
    AddCluster(i, R, T.t, kernel_sigma, &one);
    if (one.weight == 0.0) continue;
    const VoxelKey key = BlockAround(R * clusters_[i].mean + T.t);
    Block& block = index.Gather(key, &blocks);
    block.key = key;
    block.H += one.H;
    block.g += one.g;
  }
  return blocks;
}

Matrix6d MapResiduals::SurfaceScatter(const SE3& T, double kernel_sigma, VoxelKey block) const {
  const Eigen::Matrix3d R = T.R();
  // In the order of the clusters: ids of surfaces are others once a map was saved and loaded, and
  // the sum has the same bits.
  std::map<VoxelMap::NodeId, std::size_t> places;
  std::vector<Vector6d> gradients;
  NormalEquations one;
  for (std::size_t i = 0; i < clusters_.size(); ++i) {
    if (surfaces_[i] == VoxelMap::kNoNode || BlockAround(R * clusters_[i].mean + T.t) != block)
      continue;
    one.g.setZero();
    AddCluster(i, R, T.t, kernel_sigma, &one);
    const std::size_t place = places.try_emplace(surfaces_[i], gradients.size()).first->second;
    if (place == gradients.size()) gradients.emplace_back(Vector6d::Zero());
    gradients[place] += one.g;
  }
  Matrix6d scatter = Matrix6d::Zero();
  for (const Vector6d& g : gradients) scatter += g * g.transpose();
  return scatter;
}

Matrix6d MapResiduals::GradientScatter(const SE3& T, double kernel_sigma) {
  // A block that determines a direction nearly alone says nothing of how well.
  constexpr double kMostShare = 0.9, kSmallShare = 0.02, kLargeShare = 0.5;
  const std::vector<Block> blocks = Blocks(T, kernel_sigma);
  Matrix6d H = Matrix6d::Zero();
  for (const Block& block : blocks) H += block.H;
  H.diagonal().array() += 1e-9 * H.trace();
  const Eigen::LLT<Matrix6d> factor(H);  // L L'
  const auto L = factor.matrixL();
  Matrix6d scatter = Matrix6d::Zero();
  for (const Block& block : blocks) {
    Vector6d g = block.g;
    // L^-1 H_s L^-T, whose eigenvalues are the block's shares.
    Matrix6d shares = L.solve(block.H);
    shares = L.solve(shares.transpose().eval());
    if (shares.trace() > kSmallShare) {
      const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(shares);
      const Vector6d left = 1.0 - eigen.eigenvalues().array().min(kMostShare).max(0.0);
      Vector6d along =
          (eigen.eigenvectors().transpose() * L.solve(g)).cwiseQuotient(left.cwiseSqrt());
      if (eigen.eigenvalues()(5) > kLargeShare) {
        // Where the block determines a direction, its residuals as a whole are fitted away; those
        // of its surfaces are not, and the larger scatter counts.
        const Matrix6d to_tangent = L * eigen.eigenvectors();
        const Matrix6d from_tangent = to_tangent.inverse();
        Matrix6d apart =
            from_tangent * SurfaceScatter(T, kernel_sigma, block.key) * from_tangent.transpose();
        for (int i = 0; i < 6; ++i) {
          if (eigen.eigenvalues()(i) > kLargeShare && apart(i, i) > along(i) * along(i)) {
            along(i) = 0.0;
          } else {
            apart.row(i).setZero();
            apart.col(i).setZero();
          }
        }
        scatter += to_tangent * apart * to_tangent.transpose();
      }
      g = L * Vector6d(eigen.eigenvectors() * along);
    }
    scatter += g * g.transpose();
  }
  return scatter;
}

MapResiduals::TwoSteps& MapResiduals::TwoSteps::operator+=(const TwoSteps& o) {
  H_pose += o.H_pose;
  H_across += o.H_across;
  H_other += o.H_other;
  g_pose += o.g_pose;
  g_other += o.g_other;
  return *this;
}

MapResiduals::TwoSteps MapResiduals::TwoStepsAt(const SE3& T, double kernel_sigma,
                                                const std::vector<StepShares>& shares) {
  const Eigen::Matrix3d R = T.R();
  Associate(T, R);
  watching_ = false;
  return ParallelSum(clusters_.size(), 1024, TwoSteps(), [&](std::size_t begin, std::size_t end) {
    TwoSteps sum;
    NormalEquations one;
    for (std::size_t i = begin; i < end; ++i) {
      one.H.setZero();
      one.g.setZero();
      AddCluster(i, R, T.t, kernel_sigma, &one);
      const auto [p, q] = shares[i];
      sum.H_pose += p * p * one.H;
      sum.H_across += p * q * one.H;
      sum.H_other += q * q * one.H;
      sum.g_pose += p * one.g;
      sum.g_other += q * one.g;
    }
    return sum;
  });
}

void MapResiduals::Associate(const SE3& T, const Eigen::Matrix3d& R) {
  constexpr double kFarM = 30.0;
  const double near_m = 0.05 * map_.options().LeafSize();
  if (associated_ &&
      (T.t - associated_at_.t).norm() + kFarM * RotationAngle(associated_at_, T) < near_m) {
    return;
  }
  associated_at_ = T;
  ParallelChunks(clusters_.size(), 1024, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Eigen::Vector3d p = R * clusters_[i].mean + T.t;
      const bool can_hold = map_.CanHold(p);
      const LeafPlace place = can_hold ? map_.PlaceOf(p) : LeafPlace();
      if (associated_ && place == places_[i]) continue;
      places_[i] = place;
      surfaces_[i] = can_hold ? map_.FindSurface(place) : VoxelMap::kNoNode;
      const bool on_plane =
          surfaces_[i] != VoxelMap::kNoNode && map_.kind(surfaces_[i]) == Surface::Kind::kPlane;
      planes_[i] = on_plane ? &map_.plane(surfaces_[i]) : nullptr;
    }
  });
  if (!associated_) FindLeastThickness();
  associated_ = true;
}

void MapResiduals::FindLeastThickness() {
  // Planes across one ring, or two, are no measure of how well beams agree.
  constexpr float kBroad2 = 0.04F;  // m^2
  std::vector<float> variances;
  for (const Surface* plane : planes_) {
    if (plane == nullptr || plane->variance < kBroad2 * plane->flatness) continue;
    variances.push_back(plane->variance);
  }
  // A quarter of them are thinner than this. Clutter thickens some planes; beams that disagree,
  // all.
  const double thickness =
      variances.empty() ? 0.0 : std::sqrt(static_cast<double>(Quantile(&variances, 0.25)));
  // kNoiseM: what the noise of ranges alone makes of it.
  constexpr double kBelief = 1.5, kBeams = 5.0, kNoiseM = 0.008;
  floor2_ = std::pow(std::max(options_.noise_floor_m, kBelief * thickness), 2);
  beam2_ = std::pow(kBeams * std::max(0.0, thickness - kNoiseM), 2);
}

void MapResiduals::AddCluster(std::size_t i, const Eigen::Matrix3d& R, const Eigen::Vector3d& t,
                              double kernel_sigma, NormalEquations* sum) const {
  const PointCluster& cluster = clusters_[i];
  if (planes_[i] != nullptr) {
    AddPlane(cluster, R, R * cluster.mean + t, *planes_[i], kernel_sigma, sum);
  } else if (use_rough && surfaces_[i] != VoxelMap::kNoNode &&
             map_.kind(surfaces_[i]) == Surface::Kind::kRough) {
    AddRough(cluster, R, R * cluster.mean + t, surfaces_[i], kernel_sigma, sum);
  }
}

void MapResiduals::AddPlane(const PointCluster& cluster, const Eigen::Matrix3d& R,
                            const Eigen::Vector3d& p, const Surface& surface, double kernel_sigma,
                            NormalEquations* sum) const {
  Row row;
  row.normal = surface.normal.cast<double>();
  row.distance = row.normal.dot(p - surface.mean);
  if (std::abs(row.distance) > options_.max_distance_m) return;
  row.normal_lidar = R.transpose() * row.normal;
  const double variance = DistanceVariance(cluster, row.normal_lidar, surface, floor2_);
  const double distance2 = row.distance * row.distance;
  const double robust = GemanMcClureWeight(distance2 / (variance * kernel_sigma * kernel_sigma));
  row.young = surface.frames < options_.young_frames && AlongSight(row.normal_lidar, cluster.mean);
  const double doubt = row.young ? options_.young_sigma_m * options_.young_sigma_m : 0.0;
  const double sight = SightWeight(surface, row.normal_lidar, cluster.mean);
  row.w =
      sight * robust * std::min(cluster.count, options_.max_cluster_weight) / (variance + doubt);
  const double breadth2 = static_cast<double>(surface.variance / surface.flatness);
  row.normal_error2 = NormalError2(static_cast<double>(surface.variance), breadth2, beam2_);
  AddRow(row, cluster.mean, sum);
  sum->robust += robust;
  sum->residual2 += robust * distance2;
  ++sum->matched;
  sum->matched_old += row.young ? 0 : 1;
}

void MapResiduals::AddRough(const PointCluster& cluster, const Eigen::Matrix3d& R,
                            const Eigen::Vector3d& p, VoxelMap::NodeId leaf, double kernel_sigma,
                            NormalEquations* sum) const {
  constexpr double kNarrow = 0.15;  // of a leaf; a leaf filled evenly has 0.29
  const PointCluster map_cluster = map_.Aggregate(leaf);
  Symmetric3 joint = map_cluster.Covariance();
  joint += cluster.Covariance().Rotated(R);
  const Eigen3 eigen = EigenDecompose(joint);
  const double widest2 = std::pow(kNarrow * map_.options().LeafSize(), 2);
  Row row;
  const bool young = map_.frames(leaf) < options_.young_frames;
  for (int i = 0; i < 3; ++i) {
    if (eigen.l(i) > widest2) continue;
    row.normal = eigen.u.col(i);
    row.normal_lidar = R.transpose() * row.normal;
    row.distance = row.normal.dot(p - map_cluster.mean);
    const double variance = floor2_ + eigen.l(i);
    const double e2 = row.distance * row.distance / (variance * kernel_sigma * kernel_sigma);
    row.w =
        GemanMcClureWeight(e2) * std::min(cluster.count, options_.max_cluster_weight) / variance;
    row.young = young && AlongSight(row.normal_lidar, cluster.mean);
    row.normal_error2 = NormalError2(eigen.l(i), eigen.l(0), beam2_);
    AddRow(row, cluster.mean, sum);
  }
}

void MapResiduals::AddRow(const Row& row, const Eigen::Vector3d& mu, NormalEquations* sum) const {
  Vector6d j;
  j << mu.cross(row.normal_lidar), row.normal;
  const Vector6d wj = row.w * j;
  // All of H: two columns at a time cost less than the triangle.
  sum->H.noalias() += wj * j.transpose();
  sum->g += row.distance * wj;
  sum->weight += row.w;
  if (!watching_) return;
  const Vector6d scaled = DividedByArm(j);
  const double arm = mu.norm() / kRotationArmM;
  const Vector6d information = sum->all.InformationOf(scaled, row.w, row.normal_error2, arm, 1.0);
  sum->all.Add(information);
  if (!row.young) sum->old.Add(information);
}

}  // namespace lamina
