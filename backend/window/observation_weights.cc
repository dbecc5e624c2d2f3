#include "backend/window/observation_weights.h"

#include <algorithm>
#include <cmath>

#include "backend/window/sliding_window.h"
#include "core/base/median.h"
#include "core/geometry/robust_kernel.h"
#include "core/map/voxel_key.h"

namespace lamina {
namespace {

// Leaves are fetched so many clusters ahead.
constexpr std::size_t kAhead = 8;
// Below this weight a cluster disagrees with its plane.
constexpr double kContestedWeight = 0.25;

}  // namespace

ObservationWeights::ObservationWeights(const VoxelMap& map, const std::deque<WindowFrame>& frames,
                                       double kernel_sigma)
    : map_(map) {
  FindPlanes(frames);
  ScaleKernels(kernel_sigma);
  Weigh(frames);
  const std::vector<Use> contested = Contested();
  constexpr int kRounds = 2;
  for (int round = 0; round < kRounds; ++round) EstimateContested(frames, contested);
}

void ObservationWeights::FindPlanes(const std::deque<WindowFrame>& frames) {
  VoxelIndex index(16384);
  for (const WindowFrame& frame : frames) {
    const std::size_t n = frame.leaves.size();
    std::vector<std::int32_t>& planes = plane_of_.emplace_back(n, kNone);
    weights_.emplace_back(n, kUnknown);
    for (std::size_t i = 0; i < n; ++i) {
      if (i + kAhead < n) map_.Prefetch(frame.leaves[i + kAhead]);
      if (frame.leaves[i] == VoxelMap::kNoNode) continue;
      const VoxelMap::NodeId node = map_.PlaneAbove(frame.leaves[i]);
      if (node == VoxelMap::kNoNode) continue;
      const auto fresh = static_cast<std::int32_t>(nodes_.size());
      planes[i] = index.FindOrInsert(static_cast<VoxelKey>(node), fresh);
      if (planes[i] != fresh) continue;
      const Surface& surface = map_.plane(node);
      nodes_.push_back(node);
      planes_.push_back({surface.mean, surface.normal.cast<double>(),
                         static_cast<double>(surface.variance), 0.0, false});
    }
  }
}

void ObservationWeights::ScaleKernels(double kernel_sigma) {
  if (planes_.empty()) return;
  constexpr double kMostOfUsual = 2.5;
  const double noise_floor_m = map_.options().noise_floor_m;
  std::vector<double> variances;
  variances.reserve(planes_.size());
  for (const Support& plane : planes_) variances.push_back(plane.variance);
  const double most = kMostOfUsual * UpperMedian(&variances);
  for (Support& plane : planes_) {
    plane.scale2 = kernel_sigma * kernel_sigma *
                   (noise_floor_m * noise_floor_m + std::min(plane.variance, most));
  }
}

double ObservationWeights::WeightOn(const Support& plane, const Eigen::Vector3d& p) const {
  const double distance = plane.normal.dot(p - plane.mean);
  return GemanMcClureWeight(distance * distance / plane.scale2);
}

void ObservationWeights::Weigh(const std::deque<WindowFrame>& frames) {
  for (std::size_t f = 0; f < frames.size(); ++f) {
    for (std::size_t i = 0; i < plane_of_[f].size(); ++i) {
      if (plane_of_[f][i] == kNone) continue;
      Support& plane = planes_[static_cast<std::size_t>(plane_of_[f][i])];
      weights_[f][i] = WeightOn(plane, frames[f].in_map[i].mean);
      if (weights_[f][i] < kContestedWeight) plane.contested = true;
    }
  }
}

std::vector<ObservationWeights::Use> ObservationWeights::Contested() const {
  std::vector<Use> contested;
  for (std::size_t f = 0; f < plane_of_.size(); ++f) {
    for (std::size_t i = 0; i < plane_of_[f].size(); ++i) {
      const std::int32_t plane = plane_of_[f][i];
      if (plane == kNone || !planes_[static_cast<std::size_t>(plane)].contested) continue;
      contested.push_back({static_cast<std::uint32_t>(f), static_cast<std::uint32_t>(i)});
    }
  }
  return contested;
}

void ObservationWeights::EstimateContested(const std::deque<WindowFrame>& frames,
                                           const std::vector<Use>& contested) {
  std::vector<PointCluster> sums(planes_.size());
  for (std::size_t p = 0; p < planes_.size(); ++p) {
    if (planes_[p].contested) sums[p] = map_.FixedAggregate(nodes_[p]);
  }
  for (const auto& [f, i] : contested) {
    sums[static_cast<std::size_t>(plane_of_[f][i])] += frames[f].in_map[i].Scaled(weights_[f][i]);
  }
  for (std::size_t p = 0; p < planes_.size(); ++p) {
    if (!planes_[p].contested || sums[p].count < map_.options().min_points) continue;
    planes_[p].mean = sums[p].mean;
    planes_[p].normal = sums[p].EigenPairs().u.col(2);
  }
  for (const auto& [f, i] : contested) {
    weights_[f][i] =
        WeightOn(planes_[static_cast<std::size_t>(plane_of_[f][i])], frames[f].in_map[i].mean);
  }
}

}  // namespace lamina
