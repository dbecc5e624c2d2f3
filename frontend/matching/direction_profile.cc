#include "frontend/matching/direction_profile.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "core/geometry/degeneracy.h"
#include "core/geometry/robust_kernel.h"
#include "frontend/matching/block_votes.h"
#include "frontend/matching/line_of_sight.h"
#include "frontend/matching/map_residuals.h"
#include "frontend/matching/plane_score.h"
#include "frontend/matching/profile_rows.h"

namespace lamina {
namespace {

constexpr double kKappa = 2.0;
// d_0: clusters of a block that make half an edge; and frames that a plane needs to have one.
constexpr double kHalfEdge = 4.0;
constexpr int kEdgeFrames = 3;
// Edges are as broad as planes are known.
constexpr double kEdgeStepM = 0.05;
// Least breadth: a single column or ring is a line, which matches the next column or ring as well.
constexpr double kBroadM = 0.05;

// The plane around a cluster that is moved in steps smaller than a leaf, looked up once for each
// leaf that it comes to. It is copied: a plane that `instead` gives need not outlive the next
// look-up.
class PlaneAround {
 public:
  // True if the plane was looked up.
  bool MoveTo(const LeafPlace& leaf, const VoxelMap& map, const PlanesInstead& instead) {
    if (leaf == leaf_) return false;
    leaf_ = leaf;
    const WeightedPlane met = PlaneOf(map, map.FindSurface(leaf), instead);
    is_plane_ = met.plane != nullptr;
    if (is_plane_) plane_ = *met.plane;
    weight_ = met.weight;
    return true;
  }

  const Surface* plane() const { return is_plane_ ? &plane_ : nullptr; }
  double weight() const { return weight_; }

 private:
  LeafPlace leaf_;  // at first nowhere
  bool is_plane_ = false;
  Surface plane_;
  double weight_ = 0.0;
};

// The part of a residual's square along a unit vector that a wrong normal may feign.
double Leak2(const Surface& surface) {
  const double breadth2 = static_cast<double>(surface.variance / surface.flatness);
  return NormalError2(static_cast<double>(surface.variance), breadth2, 0.0);
}

// Information along the direction, per weight, that counts of a residual on this surface.
double CountingAlong(const Surface& surface, double leak2, const Eigen::Vector3d& normal_lidar,
                     const Eigen::Vector3d& mu, const Vector6d& direction) {
  Vector6d j;
  j << mu.cross(normal_lidar), surface.normal.cast<double>();
  const double along = DividedByArm(j).dot(direction);
  const double counting = along * along - leak2;
  return counting < kLeastCounting ? 0.0 : counting;
}

// Inverse square, 1/m^2, of the scale of a cluster's kernel on a plane with this normal.
double InverseScale2(const PointCluster& cluster, const Surface& surface,
                     const Eigen::Vector3d& normal_lidar, double floor2) {
  return 1.0 /
         (kProfileSigma * kProfileSigma * DistanceVariance(cluster, normal_lidar, surface, floor2));
}

// 1 - rho of a cluster whose mean is at p.
double KernelFit(const Surface& surface, const Eigen::Vector3d& p, double inverse_scale2) {
  const double distance = surface.Distance(p);
  return GemanMcClureFit(distance * distance * inverse_scale2);
}

// The clusters whose middle eigenvalue is that of more than a line.
std::vector<PointCluster> BroadOnes(const std::vector<PointCluster>& clusters) {
  std::vector<Symmetric3> covariances;
  covariances.reserve(clusters.size());
  for (const PointCluster& cluster : clusters) covariances.push_back(cluster.Covariance());
  std::vector<Eigen3> eigen(clusters.size());
  EigenDecompose(covariances.data(), covariances.size(), eigen.data());
  std::vector<PointCluster> broad;
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    if (!(eigen[i].l(1) < kBroadM * kBroadM)) broad.push_back(clusters[i]);
  }
  return broad;
}

// Whether a cluster fits the plane around it while it is moved in steps smaller than a leaf. What
// that makes of the cluster is worked out once for each leaf.
class MovedMisfit {
 public:
  MovedMisfit(const PointCluster& cluster, const VoxelMap& map, const PlanesInstead& instead,
              const Vector6d& direction, double floor2)
      : cluster_(cluster), map_(map), instead_(instead), direction_(direction), floor2_(floor2) {}

  // 1 - c (1 - rho) on a plane that has edges and does not face the direction, else 0.
  // `leaf`: where R and t take the cluster.
  double At(const LeafPlace& leaf, const Eigen::Matrix3d& R, const Eigen::Vector3d& t) {
    if (around_.MoveTo(leaf, map_, instead_)) Meet(R);
    if (around_.plane() == nullptr || !has_edges_) return 0.0;
    const Eigen::Vector3d p = R * cluster_.mean + t;
    return 1.0 - sight_ * KernelFit(*around_.plane(), p, inverse_scale2_);
  }

 private:
  void Meet(const Eigen::Matrix3d& R) {
    const Surface* const plane = around_.plane();
    if (plane == nullptr) return;
    const Eigen::Vector3d normal_lidar = R.transpose() * plane->normal.cast<double>();
    has_edges_ = plane->frames >= kEdgeFrames && CountingAlong(*plane, Leak2(*plane), normal_lidar,
                                                               cluster_.mean, direction_) == 0.0;
    if (!has_edges_) return;
    sight_ = SightWeight(*plane, normal_lidar, cluster_.mean);
    inverse_scale2_ = InverseScale2(cluster_, *plane, normal_lidar, floor2_);
  }

  const PointCluster& cluster_;
  const VoxelMap& map_;
  const PlanesInstead& instead_;
  const Vector6d& direction_;
  double floor2_;
  PlaneAround around_;
  bool has_edges_ = false;
  double sight_ = 0.0, inverse_scale2_ = 0.0;
};

// Mean and standard deviation of a posterior narrower than the distance of its places: by the
// parabola through the cost of the likeliest place and of those beside it.
DirectionProfile::Posterior Narrow(const std::vector<double>& places,
                                   const std::vector<double>& costs) {
  constexpr double kLeastSigmaM = 5e-4;  // planes of a map are off by as much, however many
  const double step_m = places[1] - places[0];
  const auto least = std::min_element(costs.begin(), costs.end());
  const auto k = std::clamp<std::ptrdiff_t>(least - costs.begin(), 1,
                                            static_cast<std::ptrdiff_t>(costs.size()) - 2);
  const double before = costs[static_cast<std::size_t>(k - 1)];
  const double at = costs[static_cast<std::size_t>(k)];
  const double after = costs[static_cast<std::size_t>(k + 1)];
  const double curvature = before - 2.0 * at + after;  // per squared step
  const double place_m = places[static_cast<std::size_t>(k)];
  if (!(curvature > 0.0)) return {places[static_cast<std::size_t>(least - costs.begin())], step_m};
  const double off = std::clamp(0.5 * (before - after) / curvature, -1.0, 1.0);
  return {place_m + step_m * off, std::max(kLeastSigmaM, step_m / std::sqrt(curvature))};
}

}  // namespace

SE3 DirectionProfile::At(double s_m) const {
  return Retract(T_world_lidar_, DividedByArm(Vector6d(s_m * direction_)));
}

class DirectionProfile::MovedCluster {
 public:
  explicit MovedCluster(std::size_t block) : block_(block) {}

  std::size_t block() const { return block_; }

  // Moves the cluster to this leaf; returns the plane around it, or null.
  const ProfilePlane* MoveTo(const DirectionProfile& profile, const LeafPlace& leaf) {
    const bool is_new = around_.MoveTo(leaf, profile.map_, profile.instead_);
    if (around_.plane() == nullptr) return nullptr;
    if (is_new) Meet(*around_.plane());
    return &plane_;
  }

 private:
  void Meet(const Surface& surface) {
    for (int k = 0; k < 3; ++k) {
      plane_.normal[k] = static_cast<double>(surface.normal[k]);
      plane_.mean[k] = surface.mean[k];
    }
    plane_.leak2 = Leak2(surface);
    plane_.variance = static_cast<double>(surface.variance);
    plane_.flatness = static_cast<double>(surface.flatness);
    plane_.weight = around_.weight();
  }

  std::size_t block_;
  PlaneAround around_;
  ProfilePlane plane_;
};

template <typename Wanted>
DirectionProfile::MovedClusters DirectionProfile::ClustersThat(const Wanted& wanted) const {
  MovedClusters those;
  VoxelIndex index(64);
  for (std::size_t i = 0; i < clusters_.size(); ++i) {
    if (!wanted(i)) continue;
    const PointCluster& cluster = clusters_[i];
    const std::int32_t block =
        index.FindOrInsert(BlockAround(cluster.mean), static_cast<std::int32_t>(index.size()));
    those.clusters.push_back(cluster);
    those.moved.emplace_back(static_cast<std::size_t>(block));
  }
  those.blocks = index.size();
  return those;
}

DirectionProfile::Loss DirectionProfile::LossAt(double s_m, MovedClusters* of) const {
  struct Block {
    double weight = 0.0, loss = 0.0;
    bool met = false;
  };
  const SE3 T = At(s_m);
  const Eigen::Matrix3d R = T.R();
  std::vector<LeafPlace> leaves(of->clusters.size());
  map_.PlacesOf(of->clusters.data(), 1, leaves.size(), R, T.t, leaves.data());
  const ProfilePlace place{R, T.t, direction_, floor2_};
  std::vector<Block> blocks(of->blocks);
  std::vector<std::size_t> met;  // in the order in which they come up
  met.reserve(of->blocks);
  constexpr std::size_t kTogether = 32;
  const PointCluster* clusters[kTogether];
  const ProfilePlane* planes[kTogether];
  std::size_t block_of[kTogether];
  ProfileRow rows[kTogether];
  std::size_t count = 0;
  const auto add = [&] {
    if (count == 0) return;
    MakeProfileRows(clusters, planes, count, place, rows);
    for (std::size_t k = 0; k < count; ++k) {
      if (!rows[k].says) continue;
      Block& block = blocks[block_of[k]];
      if (!std::exchange(block.met, true)) met.push_back(block_of[k]);
      block.weight += rows[k].weight;
      block.loss += rows[k].weight * rows[k].loss;
    }
    count = 0;
  };
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    planes[count] = of->moved[i].MoveTo(*this, leaves[i]);
    if (planes[count] == nullptr) continue;
    clusters[count] = &of->clusters[i];
    block_of[count] = of->moved[i].block();
    if (++count == kTogether) add();
  }
  add();
  Loss sum;
  for (const std::size_t b : met) {
    const Block& block = blocks[b];
    const double counts = block.weight / (block.weight + kHalfVoteInformation);
    sum.blocks += counts;
    sum.loss += kKappa * counts * block.loss / block.weight;
  }
  return sum;
}

double DirectionProfile::Blocks() const {
  MovedClusters all = ClustersThat([](std::size_t) { return true; });
  return LossAt(0.0, &all).blocks;
}

DirectionProfile::MovedClusters DirectionProfile::Facing(double from_m, double to_m) const {
  constexpr std::size_t kTogether = 64;
  const double step_m = 0.5 * map_.options().LeafSize();
  const int steps = std::max(1, static_cast<int>(std::ceil((to_m - from_m) / step_m)));
  struct Place {
    Eigen::Matrix3d R;
    Eigen::Vector3d t;
    LeafPlace leaves[kTogether];  // where it takes some of the clusters
  };
  std::vector<Place> places;
  for (int i = 0; i <= steps; ++i) {
    const SE3 T = At(from_m + i * (to_m - from_m) / steps);
    places.push_back({T.R(), T.t, {}});
  }
  // Called for one cluster after the other: leaves are looked up for many of them at once.
  return ClustersThat([&](std::size_t i) {
    const std::size_t k = i % kTogether, count = std::min(kTogether, clusters_.size() - i);
    for (Place& place : places) {
      if (k == 0) map_.PlacesOf(&clusters_[i], 1, count, place.R, place.t, place.leaves);
    }
    PlaneAround around;
    return std::any_of(places.begin(), places.end(), [&](const Place& place) {
      around.MoveTo(place.leaves[k], map_, instead_);
      const Surface* const plane = around.plane();
      if (plane == nullptr) return false;
      const Eigen::Vector3d normal_lidar = place.R.transpose() * plane->normal.cast<double>();
      return CountingAlong(*plane, Leak2(*plane), normal_lidar, clusters_[i].mean, direction_) >
             0.0;
    });
  });
}

std::vector<double> DirectionProfile::EdgeLosses(double from_m, double to_m, int steps) const {
  const std::size_t places = static_cast<std::size_t>(steps) + 1;
  const std::vector<PointCluster> broad = BroadOnes(clusters_);
  VoxelIndex index(64);
  std::vector<std::vector<double>> fits;  // F of each block at each place
  std::vector<std::size_t> blocks_of;
  std::vector<MovedMisfit> misfits;
  for (const PointCluster& cluster : broad) {
    std::vector<double>& fit = index.Gather(BlockAround(cluster.mean), &fits);
    if (fit.empty()) fit.assign(places, 0.0);
    blocks_of.push_back(static_cast<std::size_t>(&fit - fits.data()));
    misfits.emplace_back(cluster, map_, instead_, direction_, floor2_);
  }
  std::vector<LeafPlace> leaves(broad.size());
  for (std::size_t k = 0; k < places; ++k) {
    const SE3 T = At(from_m + static_cast<int>(k) * (to_m - from_m) / steps);
    const Eigen::Matrix3d R = T.R();
    map_.PlacesOf(broad.data(), 1, broad.size(), R, T.t, leaves.data());
    for (std::size_t i = 0; i < broad.size(); ++i)
      fits[blocks_of[i]][k] -= misfits[i].At(leaves[i], R, T.t);
  }
  // The pose, having so many parameters, fits as many blocks, whatever it is.
  constexpr double kFitted = 6.0;
  const double blocks = static_cast<double>(fits.size());
  const double counts = kKappa * std::max(0.0, blocks - kFitted) / std::max(1.0, blocks);
  std::vector<double> losses(places, 0.0);
  for (const std::vector<double>& fit : fits) {
    const double best = *std::max_element(fit.begin(), fit.end());
    for (std::size_t k = 0; k < places; ++k) {
      const double missing = best - fit[k];
      losses[k] += counts * missing / (kHalfEdge + missing);
    }
  }
  return losses;
}

DirectionProfile::Posterior DirectionProfile::With(double predicted_m,
                                                   double predicted_sigma_m) const {
  constexpr double kStepM = 0.01, kSigmas = 3.0, kBesideM = 0.1, kMostM = 1.0;
  constexpr int kMostSteps = 100;
  const double reach_m = std::min(kSigmas * predicted_sigma_m + kBesideM, kMostM);
  const double from_m = std::min(-kBesideM, predicted_m - reach_m);
  const double to_m = std::max(kBesideM, predicted_m + reach_m);
  const int steps = std::min(kMostSteps, static_cast<int>(std::ceil((to_m - from_m) / kStepM)));
  MovedClusters facing = Facing(from_m, to_m);
  const int edge_steps = static_cast<int>(std::ceil((to_m - from_m) / kEdgeStepM));
  const std::vector<double> edges = EdgeLosses(from_m, to_m, edge_steps);
  std::vector<double> places, costs;
  for (int i = 0; i <= steps; ++i) {
    const double s = from_m + i * (to_m - from_m) / steps;
    const double off = (s - predicted_m) / predicted_sigma_m;
    const double at = static_cast<double>(i) * edge_steps / steps;
    const std::size_t k = static_cast<std::size_t>(std::min(static_cast<int>(at), edge_steps - 1));
    const double edge = edges[k] + (at - static_cast<double>(k)) * (edges[k + 1] - edges[k]);
    places.push_back(s);
    costs.push_back(LossAt(s, &facing).loss + edge + 0.5 * off * off);
  }
  const double least = *std::min_element(costs.begin(), costs.end());
  double sum = 0.0, first = 0.0, second = 0.0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const double weight = std::exp(least - costs[i]);
    sum += weight;
    first += weight * places[i];
    second += weight * places[i] * places[i];
  }
  const double mean = first / sum;
  const Posterior posterior{mean, std::sqrt(std::max(0.0, second / sum - mean * mean))};
  return posterior.sigma_m < 0.7 * (places[1] - places[0]) ? Narrow(places, costs) : posterior;
}

}  // namespace lamina
