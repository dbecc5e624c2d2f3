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
  H_rings += o.H_rings;
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

template <typename Visit>
void MapResiduals::ForEachRows(std::size_t begin, std::size_t end, const RowSettings& settings,
                               const Visit& visit) const {
  constexpr std::size_t kTogether = 32;
  const PointCluster* clusters[kTogether];
  const Surface* planes[kTogether];
  std::size_t of[kTogether];
  MatchRow rows[kTogether];
  std::size_t count = 0;
  const auto visit_planes = [&] {
    if (count == 0) return;
    MakePlaneRows(clusters, planes, count, settings, options_, rows);
    visit(rows, of, count);
    count = 0;
  };
  for (std::size_t i = begin; i < end; ++i) {
    if (planes_[i] != nullptr) {
      clusters[count] = &clusters_[i];
      planes[count] = planes_[i];
      of[count] = i;
      if (++count == kTogether) visit_planes();
    } else if (use_rough && surfaces_[i] != VoxelMap::kNoNode &&
               map_.kind(surfaces_[i]) == Surface::Kind::kRough) {
      visit_planes();
      of[0] = of[1] = of[2] = i;
      const std::size_t narrow = MakeRoughRows(clusters_[i], surfaces_[i], settings, rows);
      if (narrow > 0) visit(rows, of, narrow);
    }
  }
  visit_planes();
}

RowSettings MapResiduals::SettingsAt(const SE3& T, double kernel_sigma) const {
  return {T.R(), T.t, kernel_sigma, map_.options().max_cluster_weight, floor2_, beam2_, use_flat};
}

NormalEquations MapResiduals::Sum(const SE3& T, double kernel_sigma, const Matrix6d* watched,
                                  bool with_normal) {
  Associate(T, T.R());
  const RowSettings settings = SettingsAt(T, kernel_sigma);
  NormalEquations zero;
  if (watched != nullptr) zero.all.directions = zero.old.directions = *watched;
  NormalEquations total =
      ParallelSum(clusters_.size(), 1024, zero, [&](std::size_t begin, std::size_t end) {
        NormalEquations sum = zero;
        RowSums sums, rings;
        EvidenceSums evidence(zero.all.directions);
        ForEachRows(begin, end, settings,
                    [&](const MatchRow* rows, const std::size_t* of, std::size_t count) {
                      if (with_normal) sums.Add(rows, count);
                      if (with_normal && rows[0].on_ring) rings.Add(rows, count);
                      if (watched != nullptr) evidence.Add(rows, of, count, clusters_.data());
                    });
        sum.H = sums.H();
        sum.H_rings = rings.H();
        sum.g = sums.g();
        sum.weight = sums.weight();
        sum.robust = sums.robust();
        sum.residual2 = sums.residual2();
        sum.matched = static_cast<int>(sums.matched);
        sum.matched_old = static_cast<int>(sums.matched_old);
        EvidenceSums::Store(evidence.all, &sum.all);
        EvidenceSums::Store(evidence.old, &sum.old);
        return sum;
      });
  // Rounding differs across the diagonal.
  total.H = total.H.selfadjointView<Eigen::Upper>();
  total.H_rings = total.H_rings.selfadjointView<Eigen::Upper>();
  return total;
}

DirectionEvidence MapResiduals::EvidenceOf(const PlanesInstead& planes, const SE3& T,
                                           double kernel_sigma, const Matrix6d& directions) {
  Associate(T, T.R());
  std::vector<double> weights(clusters_.size(), 0.0);
  for (std::size_t i = 0; i < clusters_.size(); ++i) {
    const WeightedPlane instead =
        surfaces_[i] == VoxelMap::kNoNode ? WeightedPlane() : planes(surfaces_[i]);
    planes_[i] = instead.plane;
    weights[i] = instead.weight;
  }
  EvidenceSums sums(directions);
  ForEachRows(0, clusters_.size(), SettingsAt(T, kernel_sigma),
              [&](MatchRow* rows, const std::size_t* of, std::size_t count) {
                for (std::size_t k = 0; k < count; ++k) rows[k].w *= weights[of[k]];
                sums.Add(rows, of, count, clusters_.data());
              });
  DirectionEvidence evidence;
  evidence.directions = directions;
  EvidenceSums::Store(sums.all, &evidence);
  return evidence;
}

MetPlanes MapResiduals::Meet(const SE3& T, double kernel_sigma, const Vector6d& direction) {
  Associate(T, T.R());
  Matrix6d directions = Matrix6d::Zero();
  directions.col(0) = direction;
  EvidenceSums says(directions);
  MetPlanes met{{}, BeamsOfScan(clusters_, T)};
  VoxelIndex place_of(256);
  ForEachRows(0, clusters_.size(), SettingsAt(T, kernel_sigma),
              [&](const MatchRow* rows, const std::size_t* of, std::size_t count) {
                for (std::size_t k = 0; k < count; ++k) {
                  if (rows[k].rough || rows[k].w == 0.0) continue;
                  const PointCluster& cluster = clusters_[of[k]];
                  const VoxelMap::NodeId id = surfaces_[of[k]];
                  MetPlanes::Plane& plane = place_of.Gather(static_cast<VoxelKey>(id), &met.planes);
                  plane.id = id;
                  plane.plane = planes_[of[k]];
                  plane.points += rows[k].robust * cluster.count;
                  plane.sums.Add(&rows[k], 1);
                  if (plane.faces) continue;
                  says.all = EvidenceSums::Sums();
                  says.Add(&rows[k], &of[k], 1, clusters_.data());
                  plane.faces = says.all.upper[0] > 0.0;
                }
              });
  return met;
}

void MapResiduals::Drop(const std::vector<VoxelMap::NodeId>& planes) {
  dropped_.insert(dropped_.end(), planes.begin(), planes.end());
  std::sort(dropped_.begin(), dropped_.end());
  for (std::size_t i = 0; i < clusters_.size(); ++i) {
    if (!IsDropped(surfaces_[i])) continue;
    surfaces_[i] = VoxelMap::kNoNode;
    planes_[i] = nullptr;
  }
}

std::vector<MapResiduals::Block> MapResiduals::Blocks(const SE3& T, double kernel_sigma) {
  Associate(T, T.R());
  const RowSettings settings = SettingsAt(T, kernel_sigma);
  VoxelIndex index(256);
  std::vector<Block> blocks;
  const auto block_of = [&](std::size_t i) -> Block& {
    const VoxelKey key = BlockAround(settings.R * clusters_[i].mean + settings.t);
    Block& block = index.Gather(key, &blocks);
    block.key = key;
    return block;
  };
  ForEachRows(0, clusters_.size(), settings,
              [&](const MatchRow* rows, const std::size_t* of, std::size_t count) {
                if (rows[0].rough) {
                  RowSums sums;
                  sums.Add(rows, count);
                  if (sums.weight() != 0.0) block_of(of[0]).sums.AddShare(sums, 1.0, 1.0);
                  return;
                }
                for (std::size_t k = 0; k < count; ++k) {
                  if (rows[k].w != 0.0) block_of(of[k]).sums.Add(&rows[k], 1);
                }
              });
  return blocks;
}

Matrix6d MapResiduals::SurfaceScatter(const SE3& T, double kernel_sigma, VoxelKey block) const {
  const RowSettings settings = SettingsAt(T, kernel_sigma);
  // In the order of the clusters, so that the sum has the same bits after a map was saved and
  // loaded, which changes the ids of surfaces.
  std::map<VoxelMap::NodeId, std::size_t> places;
  std::vector<Vector6d> gradients;
  for (std::size_t i = 0; i < clusters_.size(); ++i) {
    if (surfaces_[i] == VoxelMap::kNoNode ||
        BlockAround(settings.R * clusters_[i].mean + settings.t) != block)
      continue;
    RowSums sums;
    ForEachRows(i, i + 1, settings,
                [&](const MatchRow* rows, const std::size_t*, std::size_t count) {
                  sums.Add(rows, count);
                });
    const std::size_t place = places.try_emplace(surfaces_[i], gradients.size()).first->second;
    if (place == gradients.size()) gradients.emplace_back(Vector6d::Zero());
    gradients[place] += sums.g();
  }
  Matrix6d scatter = Matrix6d::Zero();
  for (const Vector6d& g : gradients) scatter += g * g.transpose();
  return scatter;
}

BlockStep MapResiduals::StepOf(const std::vector<Block>& blocks) {
  Eigen::Matrix3d H = 0.5 * kHalfVoteInformation * Eigen::Matrix3d::Identity();
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  for (const Block& block : blocks) {
    const Eigen::Matrix3d H_b = block.sums.H().bottomRightCorner<3, 3>();
    const double vote = kHalfVoteInformation / (kHalfVoteInformation + H_b.trace());
    const Eigen::Vector3d g_b = vote * block.sums.g().tail<3>();
    H += vote * H_b;
    g += g_b;
    scatter += g_b * g_b.transpose();
  }
  BlockStep step;
  const Eigen::LDLT<Eigen::Matrix3d> factor(H);
  step.step_m = -factor.solve(g);
  const double length_m = step.step_m.norm();
  if (length_m == 0.0) return step;
  const Eigen::Vector3d along = factor.solve(Eigen::Vector3d(step.step_m / length_m));
  const double variance = along.dot(scatter * along);
  step.sigmas = variance > 0.0 ? length_m / std::sqrt(variance) : 0.0;
  return step;
}

Matrix6d MapResiduals::GradientScatter(const SE3& T, double kernel_sigma, BlockStep* step) {
  // Bound on a block's share: one that determines a direction nearly alone shows no error of it.
  constexpr double kMostShare = 0.9, kSmallShare = 0.02, kLargeShare = 0.5;
  const std::vector<Block> blocks = Blocks(T, kernel_sigma);
  *step = StepOf(blocks);
  Matrix6d H = Matrix6d::Zero();
  for (const Block& block : blocks) H += block.sums.H();
  H.diagonal().array() += 1e-9 * H.trace();
  const Eigen::LLT<Matrix6d> factor(H);  // L L'
  const auto L = factor.matrixL();
  const Matrix6d inverse = factor.solve(Matrix6d::Identity());
  Matrix6d scatter = Matrix6d::Zero();
  for (const Block& block : blocks) {
    Vector6d g = block.sums.g();
    const Matrix6d H_s = block.sums.H();
    // The eigenvalues of L^-1 H_s L^-T are the block's shares, and their sum is tr H_s H^-1.
    if (H_s.cwiseProduct(inverse).sum() > kSmallShare) {
      Matrix6d shares = L.solve(H_s);
      shares = L.solve(shares.transpose().eval());
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

TwoStepRows MapResiduals::TwoStepsAt(const SE3& T, double kernel_sigma,
                                     const std::vector<StepShares>& shares) {
  Associate(T, T.R());
  const RowSettings settings = SettingsAt(T, kernel_sigma);
  return ParallelSum(
      clusters_.size(), 1024, TwoStepRows(), [&](std::size_t begin, std::size_t end) {
        TwoStepRows sum;
        ForEachRows(begin, end, settings,
                    [&](const MatchRow* rows, const std::size_t* of, std::size_t count) {
                      if (rows[0].rough) {
                        RowSums sums;
                        sums.Add(rows, count);
                        sum.Add(sums, shares[of[0]]);
                        return;
                      }
                      for (std::size_t k = 0; k < count; ++k) sum.Add(rows[k], shares[of[k]]);
                    });
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
    constexpr std::size_t kTogether = 64;
    LeafPlace places[kTogether];
    for (std::size_t first = begin; first < end; first += kTogether) {
      const std::size_t count = std::min(kTogether, end - first);
      map_.PlacesOf(&clusters_[first], 1, count, R, T.t, places);
      for (std::size_t k = 0; k < count; ++k) {
        const std::size_t i = first + k;
        if (associated_ && places[k] == places_[i]) continue;
        places_[i] = places[k];
        surfaces_[i] = map_.FindSurface(places[k]);
        if (IsDropped(surfaces_[i])) surfaces_[i] = VoxelMap::kNoNode;
        const bool on_plane =
            surfaces_[i] != VoxelMap::kNoNode && map_.kind(surfaces_[i]) == Surface::Kind::kPlane;
        planes_[i] = on_plane ? &map_.plane(surfaces_[i]) : nullptr;
      }
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
  // The lower quartile. Clutter thickens some planes; beams that disagree thicken all.
  const double thickness =
      variances.empty() ? 0.0 : std::sqrt(static_cast<double>(Quantile(&variances, 0.25)));
  // kNoiseM: thickness due to the noise of ranges alone.
  constexpr double kBelief = 1.5, kBeams = 5.0, kNoiseM = 0.008;
  floor2_ = std::pow(std::max(map_.options().noise_floor_m, kBelief * thickness), 2);
  beam2_ = std::pow(kBeams * std::max(0.0, thickness - kNoiseM), 2);
}

std::size_t MapResiduals::MakeRoughRows(const PointCluster& cluster, VoxelMap::NodeId leaf,
                                        const RowSettings& settings, MatchRow* rows) const {
  constexpr double kNarrow = 0.15;  // of a leaf; a leaf filled evenly has 0.29
  const Eigen::Matrix3d& R = settings.R;
  const PointCluster map_cluster = map_.Aggregate(leaf);
  Symmetric3 joint = map_cluster.Covariance();
  joint += cluster.Covariance().Rotated(R);
  const Eigen3 eigen = EigenDecompose(joint);
  const double widest2 = std::pow(kNarrow * map_.options().LeafSize(), 2);
  const Eigen::Vector3d from_leaf = R * cluster.mean + settings.t - map_cluster.mean;
  const bool young = map_.frames(leaf) < options_.young_frames;
  const bool on_ring = OnOneRing(joint, R, cluster.mean);
  std::size_t count = 0;
  for (int i = 0; i < 3; ++i) {
    if (eigen.l(i) > widest2) continue;
    MatchRow& row = rows[count++];
    row = MatchRow();
    const Eigen::Vector3d normal = eigen.u.col(i);
    const Eigen::Vector3d normal_lidar = R.transpose() * normal;
    Eigen::Map<Vector6d>(row.j) << cluster.mean.cross(normal_lidar), normal;
    row.distance = normal.dot(from_leaf);
    const double variance = floor2_ + eigen.l(i);
    const double e2 =
        row.distance * row.distance / (variance * settings.kernel_sigma * settings.kernel_sigma);
    row.w = GemanMcClureWeight(e2) * std::min(cluster.count, settings.most_weight) / variance;
    row.rough = true;
    row.young = young && AlongSight(normal_lidar, cluster.mean);
    row.on_ring = on_ring;
    row.normal_error2 = on_ring ? kAnyNormal : NormalError2(eigen.l(i), eigen.l(0), beam2_);
  }
  return count;
}

}  // namespace lamina
