#include "frontend/matching/direction_profile.h"

#include <algorithm>
#include <cmath>

#include "core/geometry/robust_kernel.h"
#include "frontend/matching/block_votes.h"
#include "frontend/matching/degeneracy.h"
#include "frontend/matching/line_of_sight.h"
#include "frontend/matching/map_residuals.h"
#include "frontend/matching/plane_score.h"

namespace lamina {
namespace {

constexpr double kKappa = 2.0;
constexpr double kKernelSigma = 2.0;
constexpr double kMostPoints = 4.0;
// Clusters of a block that make half an edge, and frames that a plane needs to have one.
constexpr double kHalfEdge = 4.0;
constexpr int kEdgeFrames = 3;
// Edges are as broad as planes are known.
constexpr double kEdgeStepM = 0.05;
// A column or a ring alone is a line, which is met again where the sensor takes the next one.
constexpr double kBroadM = 0.05;

// The plane around p, or what stands in for it; null if there is none.
WeightedPlane PlaneIn(const VoxelMap& map, const PlanesInstead& instead, const Eigen::Vector3d& p) {
  if (!instead) return {map.PlaneAt(p), 1.0};
  const VoxelMap::NodeId surface = map.FindSurface(p);
  return surface == VoxelMap::kNoNode ? WeightedPlane() : instead(surface);
}

// Of a residual with this scaled row, along the direction, per weight.
double CountingAlong(const Surface& surface, const Eigen::Vector3d& normal_lidar,
                     const Eigen::Vector3d& mu, const Vector6d& direction) {
  constexpr double kLeast = 0.05;
  Vector6d j;
  j << mu.cross(normal_lidar), surface.normal.cast<double>();
  const double along = DividedByArm(j).dot(direction);
  const double breadth2 = static_cast<double>(surface.variance / surface.flatness);
  const double leak2 = NormalError2(static_cast<double>(surface.variance), breadth2, 0.0);
  const double counting = along * along - leak2;
  return counting < kLeast ? 0.0 : counting;
}

// Inverse square, 1/m^2, of the scale of a cluster's kernel on a plane with this normal.
double InverseScale2(const PointCluster& cluster, const Surface& surface,
                     const Eigen::Vector3d& normal_lidar, double floor2) {
  return 1.0 /
         (kKernelSigma * kKernelSigma * DistanceVariance(cluster, normal_lidar, surface, floor2));
}

// 1 - rho of a cluster whose mean is at p.
double KernelFit(const Surface& surface, const Eigen::Vector3d& p, double inverse_scale2) {
  const double distance = surface.Distance(p);
  return GemanMcClureFit(distance * distance * inverse_scale2);
}

// Middle eigenvalue of a cluster's covariance.
double Breadth2(const PointCluster& cluster) { return EigenDecompose(cluster.Covariance()).l(1); }

// Whether a cluster fits the plane around it while it is moved in steps smaller than a leaf. Planes
// are looked up, and what they make of the cluster is worked out, once for each leaf.
class MovedCluster {
 public:
  MovedCluster(const PointCluster& cluster, const VoxelMap& map, const PlanesInstead& instead,
               const Vector6d& direction, double floor2)
      : cluster_(cluster), map_(map), instead_(instead), direction_(direction), floor2_(floor2) {}

  // 1 - c (1 - rho) on a plane that has edges and does not face the direction, else 0.
  double Misfit(const Eigen::Matrix3d& R, const Eigen::Vector3d& t) {
    const Eigen::Vector3d p = R * cluster_.mean + t;
    if (!map_.CanHold(p)) return 0.0;
    const LeafPlace place = map_.PlaceOf(p);
    if (!any_ || !(place == place_)) Meet(R, p);
    place_ = place;
    any_ = true;
    if (plane_ == nullptr) return 0.0;
    return 1.0 - sight_ * KernelFit(*plane_, p, inverse_scale2_);
  }

 private:
  void Meet(const Eigen::Matrix3d& R, const Eigen::Vector3d& p) {
    plane_ = PlaneIn(map_, instead_, p).plane;
    if (plane_ == nullptr) return;
    const Eigen::Vector3d normal_lidar = R.transpose() * plane_->normal.cast<double>();
    if (plane_->frames < kEdgeFrames ||
        CountingAlong(*plane_, normal_lidar, cluster_.mean, direction_) != 0.0) {
      plane_ = nullptr;
      return;
    }
    sight_ = SightWeight(*plane_, normal_lidar, cluster_.mean);
    inverse_scale2_ = InverseScale2(cluster_, *plane_, normal_lidar, floor2_);
  }

  const PointCluster& cluster_;
  const VoxelMap& map_;
  const PlanesInstead& instead_;
  const Vector6d& direction_;
  double floor2_;
  bool any_ = false;
  LeafPlace place_;
  const Surface* plane_ = nullptr;
  double sight_ = 0.0, inverse_scale2_ = 0.0;
};

// Of a posterior that is narrower than its places are apart: the parabola through the cost of the
// likeliest one and of those beside it.
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

DirectionProfile::Loss DirectionProfile::LossAt(const std::vector<PointCluster>& clusters,
                                                double s_m) const {
  struct Block {
    double weight = 0.0, loss = 0.0;
  };
  const SE3 T = At(s_m);
  const Eigen::Matrix3d R = T.R();
  VoxelIndex index(64);
  std::vector<Block> blocks;
  for (const PointCluster& cluster : clusters) {
    const Eigen::Vector3d p = R * cluster.mean + T.t;
    const auto [surface, share] = PlaneIn(map_, instead_, p);
    if (surface == nullptr) continue;
    const Eigen::Vector3d normal_lidar = R.transpose() * surface->normal.cast<double>();
    const double counting = CountingAlong(*surface, normal_lidar, cluster.mean, direction_);
    if (counting == 0.0) continue;
    const double inverse_scale2 = InverseScale2(cluster, *surface, normal_lidar, floor2_);
    const double weight = share * SightWeight(*surface, normal_lidar, cluster.mean) * counting *
                          std::min(cluster.count, kMostPoints) * kKernelSigma * kKernelSigma *
                          inverse_scale2;
    Block& block = index.Gather(BlockAround(cluster.mean), &blocks);
    block.weight += weight;
    block.loss += weight * (0.5 - KernelFit(*surface, p, inverse_scale2));
  }
  Loss sum;
  for (const Block& block : blocks) {
    const double counts = block.weight / (block.weight + kHalfVoteInformation);
    sum.blocks += counts;
    sum.loss += kKappa * counts * block.loss / block.weight;
  }
  return sum;
}

double DirectionProfile::Blocks() const { return LossAt(clusters_, 0.0).blocks; }

std::vector<PointCluster> DirectionProfile::Facing(double from_m, double to_m) const {
  const double step_m = 0.5 * map_.options().LeafSize();
  const int steps = std::max(1, static_cast<int>(std::ceil((to_m - from_m) / step_m)));
  std::vector<SE3> places;
  for (int i = 0; i <= steps; ++i) places.push_back(At(from_m + i * (to_m - from_m) / steps));
  std::vector<PointCluster> facing;
  for (const PointCluster& cluster : clusters_) {
    const bool faces = std::any_of(places.begin(), places.end(), [&](const SE3& T) {
      const Surface* surface = PlaneIn(map_, instead_, T * cluster.mean).plane;
      if (surface == nullptr) return false;
      const Eigen::Vector3d normal_lidar =
          T.q.conjugate() * Eigen::Vector3d(surface->normal.cast<double>());
      return CountingAlong(*surface, normal_lidar, cluster.mean, direction_) > 0.0;
    });
    if (faces) facing.push_back(cluster);
  }
  return facing;
}

std::vector<double> DirectionProfile::EdgeLosses(double from_m, double to_m, int steps) const {
  const std::size_t places = static_cast<std::size_t>(steps) + 1;
  struct Place {
    Eigen::Matrix3d R;
    Eigen::Vector3d t;
  };
  std::vector<Place> at;
  for (int k = 0; k <= steps; ++k) {
    const SE3 T = At(from_m + k * (to_m - from_m) / steps);
    at.push_back({T.R(), T.t});
  }
  VoxelIndex index(64);
  std::vector<std::vector<double>> fits;  // F of each block at each place
  for (const PointCluster& cluster : clusters_) {
    if (Breadth2(cluster) < kBroadM * kBroadM) continue;
    std::vector<double>& fit = index.Gather(BlockAround(cluster.mean), &fits);
    if (fit.empty()) fit.assign(places, 0.0);
    MovedCluster moved(cluster, map_, instead_, direction_, floor2_);
    for (std::size_t k = 0; k < places; ++k) fit[k] -= moved.Misfit(at[k].R, at[k].t);
  }
  // As many of them as the pose has parameters are fitted, whatever it is.
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
  const std::vector<PointCluster> facing = Facing(from_m, to_m);
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
    costs.push_back(LossAt(facing, s).loss + edge + 0.5 * off * off);
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
