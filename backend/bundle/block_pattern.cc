#include "backend/bundle/block_pattern.h"

#include <algorithm>
#include <utility>

namespace lamina {

BlockPattern::BlockPattern(const BundleProblem& problem, const BundleIndex& index)
    : partners_(problem.poses.size()) {
  std::vector<std::vector<int>> prior_partners(partners_.size());
  for (const RelativePrior& prior : problem.priors) {
    prior_partners[static_cast<std::size_t>(std::max(prior.a, prior.b))].push_back(
        std::min(prior.a, prior.b));
  }
  std::vector<std::size_t> seen_by(partners_.size(), partners_.size());  // last frame that met it
  for (std::size_t f = 0; f < partners_.size(); ++f) {
    const auto add = [&](int k) {
      if (std::exchange(seen_by[static_cast<std::size_t>(k)], f) != f) partners_[f].push_back(k);
    };
    for (auto* e = index.begin(f); e != index.end(f); ++e) {
      const Plane& plane = problem.planes[static_cast<std::size_t>(e->plane)];
      for (int o = plane.first; o <= e->observation; ++o) {
        add(problem.observations[static_cast<std::size_t>(o)].frame);
      }
    }
    for (const int k : prior_partners[f]) add(k);
    add(static_cast<int>(f));
    std::sort(partners_[f].begin(), partners_[f].end());
  }
}

double BlockPattern::Density() const {
  double blocks = 0.0;
  for (const auto& partners : partners_) blocks += static_cast<double>(partners.size());
  const auto n = static_cast<double>(partners_.size());
  return n > 0.0 ? blocks / (0.5 * n * (n + 1.0)) : 0.0;
}

}  // namespace lamina
