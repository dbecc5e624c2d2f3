#include "backend/tiles/keyframe_ties.h"

#include <cmath>

#include "backend/anchors/anchor_prior.h"
#include "core/base/angle.h"

namespace lamina {
namespace {

// What successive keyframes are off by even if they are at one place.
constexpr double kLeastDeg = 0.05, kLeastM = 0.01;

RelativePrior OdometryPrior(std::size_t a, std::size_t b, const SE3& T_a_b,
                            const LoopOptions& options) {
  const double way_m = std::sqrt(T_a_b.t.norm() * options.submap.length_m);
  const double rad =
      Radians(std::hypot(kLeastDeg, 0.01 * options.drift_sigma_deg_per_100m * way_m));
  const double m = std::hypot(kLeastM, 0.01 * options.drift_sigma_percent * way_m);
  RelativePrior prior;
  prior.a = static_cast<int>(a);
  prior.b = static_cast<int>(b);
  prior.T_a_b = T_a_b;
  prior.sqrt_information.setZero();
  prior.sqrt_information.diagonal() << Eigen::Vector3d::Constant(1.0 / rad),
      Eigen::Vector3d::Constant(1.0 / m);
  return prior;
}

}  // namespace

std::vector<std::size_t> FirstKeyframes(const std::vector<const Submap*>& submaps) {
  std::vector<std::size_t> first{0};
  for (const Submap* submap : submaps) first.push_back(first.back() + submap->keyframes.size());
  return first;
}

BundleProblem TiesOfKeyframes(const std::vector<const Submap*>& submaps, const AnchorGraph& graph,
                              const std::vector<SE3>& poses, const LoopOptions& options) {
  const std::vector<std::size_t> first = FirstKeyframes(submaps);
  BundleProblem ties;
  ties.poses = poses;
  for (std::size_t i = 0; i < submaps.size(); ++i) {
    const std::vector<SubmapKeyframe>& keyframes = submaps[i]->keyframes;
    for (std::size_t k = 1; k < keyframes.size(); ++k) {
      const SE3 T = keyframes[k - 1].T_submap_lidar.Inverse() * keyframes[k].T_submap_lidar;
      ties.priors.push_back(OdometryPrior(first[i] + k - 1, first[i] + k, T, options));
    }
  }
  const auto tie_first = [&](const AnchorEdge& edge) {
    RelativePrior prior = PriorOf(edge);
    prior.a = static_cast<int>(first[edge.from]);
    prior.b = static_cast<int>(first[edge.to]);
    ties.priors.push_back(prior);
  };
  for (const AnchorEdge& edge : graph.odometry) {
    // Across what was trimmed odometry drifted longer than the distance tells.
    if (!Follows(*submaps[edge.to], *submaps[edge.from])) {
      tie_first(edge);
      continue;
    }
    const SE3 T = submaps[edge.from]->keyframes.back().T_submap_lidar.Inverse() * edge.T_from_to;
    ties.priors.push_back(OdometryPrior(first[edge.from + 1] - 1, first[edge.to], T, options));
  }
  for (const AnchorEdge& edge : graph.loops) tie_first(edge);
  return ties;
}

}  // namespace lamina
