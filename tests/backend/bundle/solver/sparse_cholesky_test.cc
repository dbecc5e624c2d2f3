#include "backend/bundle/solver/sparse_cholesky.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <vector>

#include "backend/bundle/condensed_cost.h"
#include "tests/support/scenes/random_bundles.h"

namespace lamina {
namespace {

// A chain: frame k shares a plane with frame k + 1 alone.
BundleProblem Chain(int frames) {
  BundleProblem problem;
  problem.poses.resize(static_cast<std::size_t>(frames));
  for (int k = 0; k + 1 < frames; ++k) {
    Plane plane;
    plane.first = static_cast<std::int32_t>(problem.observations.size());
    plane.count = 2;
    problem.observations.push_back({k, {}});
    problem.observations.push_back({k + 1, {}});
    problem.planes.push_back(plane);
  }
  return problem;
}

// Its upper triangle with these blocks on the diagonal and `beside` in those next to it.
Eigen::SparseMatrix<double> Upper(const BlockPattern& pattern, double diagonal, double beside) {
  std::vector<Eigen::Triplet<double>> entries;
  for (std::size_t f = 0; f < pattern.frames(); ++f) {
    for (const std::int32_t k : pattern.partners(f)) {
      for (int c = 0; c < 6; ++c) {
        const bool own = static_cast<std::size_t>(k) == f;
        for (int r = 0; r < (own ? c + 1 : 6); ++r) {
          entries.emplace_back(6 * k + r, static_cast<int>(6 * f) + c,
                               own && r == c ? diagonal : beside / (1.0 + r + 2.0 * c));
        }
      }
    }
  }
  const auto size = static_cast<Eigen::Index>(6 * pattern.frames());
  Eigen::SparseMatrix<double> H(size, size);
  H.setFromTriplets(entries.begin(), entries.end());
  return H;
}

TEST(SparseCholesky, SolvesAsADenseOneWithFarFewerProducts) {
  const BundleProblem problem = Chain(60);
  const BlockPattern pattern(problem, BundleIndex(problem));
  SparseCholesky cholesky;
  EXPECT_LT(cholesky.Order(pattern), 0.02);
  for (const double diagonal : {3.0, 5.0}) {  // values change, the structure stays
    const Eigen::SparseMatrix<double> H = Upper(pattern, diagonal, 0.5);
    ASSERT_TRUE(cholesky.Factorise(H));
    const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(H.cols(), -1.0, 2.0);
    const Eigen::MatrixXd all = Eigen::MatrixXd(H).selfadjointView<Eigen::Upper>();
    const Eigen::VectorXd expected = all.llt().solve(b);
    EXPECT_LT((cholesky.Solve(b) - expected).norm(), 1e-12 * expected.norm());
  }
}

TEST(SparseCholesky, SaysWhenAMatrixIsNotPositiveDefinite) {
  const BundleProblem problem = Chain(60);
  const BlockPattern pattern(problem, BundleIndex(problem));
  SparseCholesky cholesky;
  cholesky.Order(pattern);
  EXPECT_FALSE(cholesky.Factorise(Upper(pattern, 0.1, 0.5)));
  EXPECT_TRUE(cholesky.Factorise(Upper(pattern, 3.0, 0.5)));  // and goes on
}

}  // namespace
}  // namespace lamina
