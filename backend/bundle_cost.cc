#include "backend/bundle_cost.h"

#include <algorithm>

#include "core/parallel.h"

namespace lamina {
namespace {

// block -= a' b, all column-major 6x6 from row-major 3x6: plain loops that compilers turn into
// vector code.
inline void SubtractProduct(const double* a, const double* b, double* block) {
  for (int c = 0; c < 6; ++c) {
    const double b0 = b[c], b1 = b[6 + c], b2 = b[12 + c];
    for (int r = 0; r < 6; ++r) {
      block[6 * c + r] -= a[r] * b0 + a[6 + r] * b1 + a[12 + r] * b2;
    }
  }
}

}  // namespace

void ReducedSystem::Assemble(const BundleProblem& problem, const BundleIndex& index,
                             Eigen::MatrixXd* H) const {
  const std::size_t frames = diagonal.size();
  const auto size = static_cast<Eigen::Index>(6 * frames);
  H->resize(size, size);
  constexpr std::size_t kChunk = 4;  // frames
  // Each frame fills its own block row, below the diagonal, in a strip that stays in the cache.
  ParallelChunks(frames, kChunk, [&](std::size_t begin, std::size_t end) {
    std::vector<double> strip;
    for (std::size_t f = begin; f < end; ++f) {
      strip.assign(36 * (f + 1), 0.0);
      Eigen::Map<Matrix6d>(strip.data() + 36 * f) = diagonal[f];
      for (auto* e = index.begin(f); e != index.end(f) && !rows.empty(); ++e) {
        const double* mine = rows[static_cast<std::size_t>(e->observation)].data();
        const std::int32_t first = problem.planes[static_cast<std::size_t>(e->plane)].first;
        for (auto o = static_cast<std::size_t>(first);
             o <= static_cast<std::size_t>(e->observation); ++o) {
          SubtractProduct(mine, rows[o].data(), strip.data() + 36 * problem.observations[o].frame);
        }
      }
      for (std::size_t k = 0; k <= f; ++k) {
        H->block<6, 6>(static_cast<Eigen::Index>(6 * f), static_cast<Eigen::Index>(6 * k)) =
            Eigen::Map<const Matrix6d>(strip.data() + 36 * k);
      }
    }
  });
  ParallelChunks(frames, kChunk, [&](std::size_t begin, std::size_t end) {
    for (auto c = static_cast<Eigen::Index>(6 * begin); c < static_cast<Eigen::Index>(6 * end);
         ++c) {
      H->col(c).head(c) = H->row(c).head(c).transpose();
    }
  });
}

}  // namespace lamina
