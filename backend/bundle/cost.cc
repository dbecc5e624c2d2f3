#include "backend/bundle/cost.h"

#include "core/base/parallel.h"

namespace lamina {
namespace {

constexpr std::size_t kFramesAChunk = 4;

}  // namespace

void ReducedSystem::FillStrip(const BundleProblem& problem, const BundleIndex& index, std::size_t f,
                              std::vector<double>* strip) const {
  strip->assign(36 * (f + 1), 0.0);
  Eigen::Map<Matrix6d>(strip->data() + 36 * f) = diagonal[f];
  for (auto* e = index.begin(f); e != index.end(f) && !rows.empty(); ++e) {
    const auto first =
        static_cast<std::size_t>(problem.planes[static_cast<std::size_t>(e->plane)].first);
    SubtractProducts(rows.data() + first, index.observed_by() + first,
                     static_cast<std::size_t>(e->observation) - first + 1, strip->data());
  }
}

void ReducedSystem::Assemble(const BundleProblem& problem, const BundleIndex& index,
                             Eigen::MatrixXd* H) const {
  const std::size_t frames = diagonal.size();
  const auto size = static_cast<Eigen::Index>(6 * frames);
  H->resize(size, size);
  // Each frame fills its own block row, below the diagonal, in a strip that stays in the cache.
  ParallelChunks(frames, kFramesAChunk, [&](std::size_t begin, std::size_t end) {
    std::vector<double> strip;
    for (std::size_t f = begin; f < end; ++f) {
      FillStrip(problem, index, f, &strip);
      for (std::size_t k = 0; k <= f; ++k) {
        H->block<6, 6>(static_cast<Eigen::Index>(6 * f), static_cast<Eigen::Index>(6 * k)) =
            Eigen::Map<const Matrix6d>(strip.data() + 36 * k);
      }
    }
  });
  ParallelChunks(frames, kFramesAChunk, [&](std::size_t begin, std::size_t end) {
    for (auto c = static_cast<Eigen::Index>(6 * begin); c < static_cast<Eigen::Index>(6 * end);
         ++c) {
      H->col(c).head(c) = H->row(c).head(c).transpose();
    }
  });
}

void ReducedSystem::Assemble(const BundleProblem& problem, const BundleIndex& index,
                             const BlockPattern& pattern, Eigen::SparseMatrix<double>* H) const {
  const std::size_t frames = diagonal.size();
  if (H->nonZeros() == 0) *H = pattern.Zeros();
  ParallelChunks(frames, kFramesAChunk, [&](std::size_t begin, std::size_t end) {
    std::vector<double> strip;
    for (std::size_t f = begin; f < end; ++f) {
      FillStrip(problem, index, f, &strip);
      // H is symmetric: column c of frame f above the diagonal is row c of its strip.
      for (std::size_t i = 0; i <= pattern.own(f); ++i) {
        const Eigen::Map<const Matrix6d> block(strip.data() + 36 * pattern.partners(f)[i]);
        for (int c = 0; c < 6; ++c) {
          const int end_row = i == pattern.own(f) ? c + 1 : 6;
          for (int r = 0; r < end_row; ++r) BlockPattern::Entry(f, i, r, c, H) = block(c, r);
        }
      }
    }
  });
}

}  // namespace lamina
