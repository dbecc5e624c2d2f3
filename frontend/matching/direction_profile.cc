#include "frontend/matching/direction_profile.h"

#include <algorithm>
#include <cmath>

#include "core/map/voxel_key.h"
#include "frontend/matching/degeneracy.h"
#include "frontend/matching/line_of_sight.h"
#include "frontend/matching/map_residuals.h"
#include "frontend/matching/plane_score.h"

namespace lamina {
namespace {

constexpr double kKappa = 2.0;
constexpr double kProfileBlockM = 4.0;
// Information, 1/m^2, with which a block counts half: that of a residual of 5 cm.
constexpr double kHalfInformation = 400.0;
constexpr double kKernelSigma = 2.0;
constexpr double kMostPoints = 4.0;

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
    const Surface* surface = PlaneAt(map_, p);
    if (surface == nullptr) continue;
    const Eigen::Vector3d normal = surface->normal.cast<double>();
    const Eigen::Vector3d normal_lidar = R.transpose() * normal;
    const double counting = CountingAlong(*surface, normal_lidar, cluster.mean, direction_);
    if (counting == 0.0) continue;
    const double variance = DistanceVariance(cluster, normal_lidar, *surface, floor2_);
    const double distance = normal.dot(p - surface->mean);
    const double e2 = distance * distance / (kKernelSigma * kKernelSigma * variance);
    const double weight = SightWeight(*surface, normal_lidar, cluster.mean) * counting *
                          std::min(cluster.count, kMostPoints) / variance;
    Block& block = index.Gather(VoxelKeyOf(cluster.mean, 1.0 / kProfileBlockM), &blocks);
    block.weight += weight;
    block.loss += weight * (e2 / (1.0 + e2) - 0.5);
  }
  Loss sum;
  for (const Block& block : blocks) {
    const double counts = block.weight / (block.weight + kHalfInformation);
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
      const Surface* surface = PlaneAt(map_, T * cluster.mean);
      if (surface == nullptr) return false;
      const Eigen::Vector3d normal_lidar =
          T.q.conjugate() * Eigen::Vector3d(surface->normal.cast<double>());
      return CountingAlong(*surface, normal_lidar, cluster.mean, direction_) > 0.0;
    });
    if (faces) facing.push_back(cluster);
  }
  return facing;
}

DirectionProfile::Posterior DirectionProfile::With(double predicted_m,
                                                   double predicted_sigma_m) const {
  constexpr double kStepM = 0.01, kSigmas = 3.0, kBesideM = 0.1, kMostM = 1.0;
  constexpr int kMostSteps = 200;
  const double reach_m = std::min(kSigmas * predicted_sigma_m + kBesideM, kMostM);
  const double from_m = std::min(-kBesideM, predicted_m - reach_m);
  const double to_m = std::max(kBesideM, predicted_m + reach_m);
  const int steps = std::min(kMostSteps, static_cast<int>(std::ceil((to_m - from_m) / kStepM)));
  const std::vector<PointCluster> facing = Facing(from_m, to_m);
  std::vector<double> places, costs;
  for (int i = 0; i <= steps; ++i) {
    const double s = from_m + i * (to_m - from_m) / steps;
    const double off = (s - predicted_m) / predicted_sigma_m;
    places.push_back(s);
    costs.push_back(LossAt(facing, s).loss + 0.5 * off * off);
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
  return {mean, std::sqrt(std::max(0.0, second / sum - mean * mean))};
}

}  // namespace lamina
