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

Eigen::SparseMatrix<double> BlockPattern::Zeros() const {
  const auto size = static_cast<Eigen::Index>(6 * frames());
  Eigen::SparseMatrix<double> H(size, size);
  Eigen::VectorXi entries(size);
  for (std::size_t f = 0; f < frames(); ++f) {
    for (int c = 0; c < 6; ++c) {
      entries(static_cast<Eigen::Index>(6 * f) + c) = 6 * static_cast<int>(own(f)) + c + 1;
    }
  }
  H.reserve(entries);
  for (std::size_t f = 0; f < frames(); ++f) {
    for (int c = 0; c < 6; ++c) {
      const int column = 6 * static_cast<int>(f) + c;
      for (std::size_t i = 0; i <= own(f); ++i) {
        const int rows = i == own(f) ? c + 1 : 6;
        for (int r = 0; r < rows; ++r) H.insert(6 * partners_[f][i] + r, column) = 0.0;
      }
    }
  }
  H.makeCompressed();
  return H;
}

Matrix6d BlockPattern::Block(std::size_t frame, std::size_t i,
                             const Eigen::SparseMatrix<double>& H) const {
  Matrix6d block;
  for (int c = 0; c < 6; ++c) {
    for (int r = 0; r < 6; ++r) {
      const bool below = i == own(frame) && r > c;
      block(r, c) = H.valuePtr()[below ? Offset(frame, i, c, r, H) : Offset(frame, i, r, c, H)];
    }
  }
  return block;
}

}  // namespace lamina
