#include "backend/bundle/cost.h"

#include <stdexcept>

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

void ReducedSystem::MoveStrip(const BlockPattern& pattern, std::size_t f,
                              Eigen::SparseMatrix<double>* H, std::vector<double>* strip,
                              bool into) {
  // H is symmetric: column c of frame f above the diagonal is row c of its strip.
  for (std::size_t i = 0; i <= pattern.own(f); ++i) {
    const auto k = static_cast<std::size_t>(pattern.partners(f)[i]);
    Eigen::Map<Matrix6d> block(strip->data() + 36 * k);
    for (int c = 0; c < 6; ++c) {
      const int end_row = i == pattern.own(f) ? c + 1 : 6;
      for (int r = 0; r < end_row; ++r) {
        double& entry = BlockPattern::Entry(f, i, r, c, H);
        (into ? entry : block(c, r)) = into ? block(c, r) : entry;
      }
    }
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
      MoveStrip(pattern, f, H, &strip, /*into=*/true);
    }
  });
}

// Planes [begin, end) whose rows are made together, and where those of each begin.
struct ReducedSystem::Part {
  std::size_t begin = 0, end = 0;
  std::vector<std::size_t> first;
  std::vector<Rows> rows;

  void Make(const BundleProblem& problem, const BundleCost& maker, std::size_t observations) {
    constexpr std::size_t kPlanesAChunk = 64;
    first.clear();
    std::size_t count = 0;
    for (end = begin; end < problem.planes.size() && (end == begin || count < observations);
         ++end) {
      first.push_back(count);
      count += static_cast<std::size_t>(problem.planes[end].count);
    }
    rows.resize(count);
    ParallelChunks(first.size(), kPlanesAChunk, [&](std::size_t a, std::size_t b) {
      for (std::size_t p = a; p < b; ++p) maker.MakeRows(begin + p, rows.data() + first[p]);
    });
  }
};

void ReducedSystem::AssembleInParts(const BundleProblem& problem, const BundleIndex& index,
                                    const BlockPattern& pattern, const BundleCost& maker,
                                    std::size_t observations,
                                    Eigen::SparseMatrix<double>* H) const {
  const std::size_t frames = diagonal.size();
  if (H->nonZeros() == 0) *H = pattern.Zeros();
  std::vector<const BundleIndex::Entry*> next;  // of each frame, the first of this part
  for (std::size_t f = 0; f < frames; ++f) next.push_back(index.begin(f));
  Part part;
  for (bool first = true; first || part.begin < problem.planes.size(); first = false) {
    part.Make(problem, maker, observations);
    ParallelChunks(frames, kFramesAChunk, [&](std::size_t begin, std::size_t end) {
      std::vector<double> strip;
      for (std::size_t f = begin; f < end; ++f) {
        const auto in_part = [&] {
          return next[f] != index.end(f) && static_cast<std::size_t>(next[f]->plane) < part.end;
        };
        if (!first && !in_part()) continue;
        strip.assign(36 * (f + 1), 0.0);
        if (first) {
          Eigen::Map<Matrix6d>(strip.data() + 36 * f) = diagonal[f];
        } else {
          MoveStrip(pattern, f, H, &strip, /*into=*/false);
        }
        for (; in_part(); ++next[f]) {
          const auto p = static_cast<std::size_t>(next[f]->plane);
          const auto o = static_cast<std::size_t>(problem.planes[p].first);
          SubtractProducts(part.rows.data() + part.first[p - part.begin], index.observed_by() + o,
                           static_cast<std::size_t>(next[f]->observation) - o + 1, strip.data());
        }
        MoveStrip(pattern, f, H, &strip, /*into=*/true);
      }
    });
    part.begin = part.end;
  }
}

void BundleCost::LineariseWithoutRows(const std::vector<SE3>& /*poses*/,
                                      ReducedSystem* /*system*/) {
  throw std::logic_error("this formulation does not make its rows in parts");
}

void BundleCost::MakeRows(std::size_t /*plane*/, ReducedSystem::Rows* /*rows*/) const {
  throw std::logic_error("this formulation does not make its rows in parts");
}

}  // namespace lamina
