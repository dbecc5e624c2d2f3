#include "backend/bundle/block_pattern.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>

namespace lamina {
namespace {

using testing::ElementsAre;

// Planes seen by frames {0, 1}, {1, 3}; frame 2 sees none.
BundleProblem FourFrames() {
  BundleProblem problem;
  problem.poses.resize(4);
  for (const auto& [a, b] : {std::pair(0, 1), std::pair(1, 3)}) {
    Plane plane;
    plane.first = static_cast<std::int32_t>(problem.observations.size());
    plane.count = 2;
    problem.observations.push_back({a, {}});
    problem.observations.push_back({b, {}});
    problem.planes.push_back(plane);
  }
  return problem;
}

TEST(BlockPattern, PartnersAreFramesBeforeThatShareAPlaneAndItself) {
  const BundleProblem problem = FourFrames();
  const BlockPattern pattern(problem, BundleIndex(problem));
  EXPECT_THAT(pattern.partners(1), ElementsAre(0, 1));
  EXPECT_THAT(pattern.partners(2), ElementsAre(2));
  EXPECT_THAT(pattern.partners(3), ElementsAre(1, 3));
  EXPECT_EQ(pattern.own(2), 0U);
  EXPECT_EQ(pattern.own(3), 1U);
}

TEST(BlockPattern, EntriesLieWhereAMatrixOfTheseBlocksHasThem) {
  const BundleProblem problem = FourFrames();
  const BlockPattern pattern(problem, BundleIndex(problem));
  Eigen::SparseMatrix<double> H = pattern.Zeros();
  EXPECT_EQ(H.nonZeros(), 4 * 21 + 2 * 36);
  double next = 1.0;
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(24, 24);
  for (std::size_t f = 0; f < pattern.frames(); ++f) {
    for (std::size_t i = 0; i <= pattern.own(f); ++i) {
      for (int c = 0; c < 6; ++c) {
        for (int r = 0; r < (i == pattern.own(f) ? c + 1 : 6); ++r) {
          const int row = 6 * pattern.partners(f)[i] + r, column = 6 * static_cast<int>(f) + c;
          expected(row, column) = expected(column, row) = next;
          BlockPattern::Entry(f, i, r, c, &H) = next++;
        }
      }
    }
  }
  EXPECT_EQ(Eigen::MatrixXd(H), Eigen::MatrixXd(expected.triangularView<Eigen::Upper>()));
  for (std::size_t f = 0; f < pattern.frames(); ++f) {
    for (std::size_t i = 0; i <= pattern.own(f); ++i) {
      const auto block = expected.block<6, 6>(6 * pattern.partners(f)[i], 6 * static_cast<int>(f));
      EXPECT_EQ(pattern.Block(f, i, H), Matrix6d(block));
    }
  }
}

}  // namespace
}  // namespace lamina
