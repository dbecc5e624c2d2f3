#include "backend/bundle/uncertainty/selected_inverse.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <limits>
#include <set>
#include <string>
#include <utility>

#include "backend/bundle/solver/formulation.h"
#include "backend/bundle/solver/held_directions.h"
#include "backend/bundle/uncertainty/pose_covariance.h"
#include "tests/support/scenes/bundle_rooms.h"

namespace lamina {
namespace {

// A random positive definite matrix with blocks at these places below the diagonal.
class BlockMatrix {
 public:
  BlockMatrix(int size, const std::set<std::pair<int, int>>& places, Draws* draws)
      : dense_(Eigen::MatrixXd::Zero(6 * size, 6 * size)) {
    // Sums of squares of two blocks each.
    const auto add = [&](int a, int b) {
      Eigen::Matrix<double, 6, 12> J;
      for (int i = 0; i < J.size(); ++i) J(i) = draws->Normal(1.0);
      const Eigen::Matrix<double, 12, 12> JJ = J.transpose() * J;
      dense_.block<6, 6>(6 * a, 6 * a) += JJ.topLeftCorner<6, 6>();
      if (a == b) return;
      dense_.block<6, 6>(6 * b, 6 * b) += JJ.bottomRightCorner<6, 6>();
      dense_.block<6, 6>(6 * a, 6 * b) += JJ.topRightCorner<6, 6>();
      dense_.block<6, 6>(6 * b, 6 * a) += JJ.bottomLeftCorner<6, 6>();
    };
    for (int k = 0; k < size; ++k) add(k, k);
    for (const auto& [row, column] : places) add(row, column);
    for (int row = 0; row < size; ++row) {
      sparse.columns.emplace_back();
      sparse.blocks.emplace_back();
      for (int column = 0; column <= row; ++column) {
        if (column < row && places.count({row, column}) == 0) continue;
        sparse.columns.back().push_back(column);
        sparse.blocks.back().push_back(dense_.block<6, 6>(6 * row, 6 * column));
      }
    }
  }

  SymmetricBlocks sparse;

  // Of the difference to the dense inverse, relative.
  double LargestError() const {
    std::vector<Matrix6d> diagonal;
    if (InvertOnDiagonal(sparse, &diagonal) != SelectedInverse::kDone) return 1e300;
    const Eigen::MatrixXd inverse = dense_.inverse();
    double largest = 0.0;
    for (std::size_t k = 0; k < diagonal.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(6 * k);
      const Matrix6d expected = inverse.block<6, 6>(i, i);
      largest = std::max(largest, (diagonal[k] - expected).norm() / expected.norm());
    }
    return std::max(largest, LargestErrorOnPattern(inverse));
  }

 private:
  // Of the blocks where the matrix has some, in units of the diagonal blocks that bound them.
  double LargestErrorOnPattern(const Eigen::MatrixXd& inverse) const {
    SymmetricBlocks blocks;
    if (InvertOnPattern(sparse, &blocks) != SelectedInverse::kDone) return 1e300;
    EXPECT_EQ(blocks.columns, sparse.columns);
    const auto expected = [&](std::size_t row, std::size_t column) {
      return Matrix6d(inverse.block<6, 6>(static_cast<Eigen::Index>(6 * row),
                                          static_cast<Eigen::Index>(6 * column)));
    };
    double largest = 0.0;
    for (std::size_t row = 0; row < blocks.columns.size(); ++row) {
      for (std::size_t i = 0; i < blocks.columns[row].size(); ++i) {
        const auto column = static_cast<std::size_t>(blocks.columns[row][i]);
        const double bound = std::sqrt(expected(row, row).norm() * expected(column, column).norm());
        largest = std::max(largest, (blocks.blocks[row][i] - expected(row, column)).norm() / bound);
      }
    }
    return largest;
  }

  Eigen::MatrixXd dense_;
};

TEST(InvertOnDiagonal, IsTheDenseInverse) {
  Draws draws(1);
  constexpr double kTolerance = 1e-9;
  for (const int size : {1, 2, 7, 40}) {
    std::set<std::pair<int, int>> chain, loop, arrow, all, none;
    for (int k = 1; k < size; ++k) {
      chain.insert({k, k - 1});
      if (k >= 3) chain.insert({k, k - 3});
      arrow.insert({k, 0});
      for (int i = 0; i < k; ++i) all.insert({k, i});
    }
    loop = chain;
    if (size > 1) loop.insert({size - 1, 0});
    if (size > 9) loop.insert({size - 2, 5});
    for (const auto& places : {chain, loop, arrow, all, none}) {
      EXPECT_LT(BlockMatrix(size, places, &draws).LargestError(), kTolerance) << size;
    }
  }
  for (int trial = 0; trial < 30; ++trial) {
    const int size = draws.Integer(2, 25);
    std::set<std::pair<int, int>> places;
    for (int i = draws.Integer(0, 2 * size); i > 0; --i) {
      const int a = draws.Integer(0, size - 1), b = draws.Integer(0, size - 1);
      if (a != b) places.insert({std::max(a, b), std::min(a, b)});
    }
    EXPECT_LT(BlockMatrix(size, places, &draws).LargestError(), kTolerance) << trial;
  }
}

// tridiag(-1, 2, -1) of size N has i (N + 1 - i) / (N + 1) on the diagonal of its inverse. Its
// dense inverse would take 4.6 GB.
TEST(InvertOnDiagonal, OfALongChainCostsNoMoreThanTheChain) {
  constexpr int kSize = 4000;
  SymmetricBlocks A;
  for (int k = 0; k < kSize; ++k) {
    A.columns.push_back(k > 0 ? std::vector<std::int32_t>{k - 1, k} : std::vector<std::int32_t>{0});
    A.blocks.emplace_back();
    if (k > 0) A.blocks.back().push_back(-Matrix6d::Identity());
    A.blocks.back().push_back(2.0 * Matrix6d::Identity());
  }
  std::vector<Matrix6d> diagonal;
  ASSERT_EQ(InvertOnDiagonal(A, &diagonal), SelectedInverse::kDone);
  for (int k = 0; k < kSize; ++k) {
    const double expected = (k + 1.0) * (kSize - k) / (kSize + 1.0);
    EXPECT_LT((diagonal[static_cast<std::size_t>(k)] - expected * Matrix6d::Identity()).norm(),
              1e-6 * expected);
  }
}

TEST(InvertOnDiagonal, SaysWhenAMatrixIsNotPositiveDefinite) {
  Draws draws(2);
  BlockMatrix matrix(5, {{1, 0}, {2, 1}, {4, 2}}, &draws);
  std::vector<Matrix6d> inverse;
  EXPECT_EQ(InvertOnDiagonal(matrix.sparse, &inverse), SelectedInverse::kDone);
  SymmetricBlocks singular = matrix.sparse, infinite = matrix.sparse;
  singular.blocks[3].back().setZero();
  infinite.blocks[2].back()(1, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(InvertOnDiagonal(singular, &inverse), SelectedInverse::kNotPositiveDefinite);
  EXPECT_TRUE(inverse.empty());
  EXPECT_EQ(InvertOnDiagonal(infinite, &inverse), SelectedInverse::kNotPositiveDefinite);
}

// A x = 0 for one x: A is the Laplacian of a ring.
TEST(InvertOnDiagonal, SaysWhenAMatrixIsAllButSingular) {
  for (const double tie : {1e-3, 1e-13, 1e-15}) {
    SymmetricBlocks A;
    constexpr int kSize = 60;
    for (int k = 0; k < kSize; ++k) {
      A.columns.push_back({k});
      A.blocks.push_back({2.0 * Matrix6d::Identity()});
      if (k == 0) A.blocks[0][0] += tie * Matrix6d::Identity();
      for (const int other : {k - 1, k == kSize - 1 ? 0 : -1}) {
        if (other < 0) continue;
        A.columns.back().insert(A.columns.back().begin(), other);
        A.blocks.back().insert(A.blocks.back().begin(), -Matrix6d::Identity());
      }
    }
    std::vector<Matrix6d> inverse;
    const SelectedInverse result = InvertOnDiagonal(A, &inverse);
    EXPECT_EQ(result == SelectedInverse::kDone, tie == 1e-3) << tie;
    EXPECT_EQ(inverse.empty(), tie != 1e-3);
  }
}

// Largest difference of the covariances from those of a dense factorisation, rotation and
// translation each for itself, over every `stride`-th frame and the last one.
double LargestCovarianceError(const BundleProblem& problem,
                              const std::vector<Matrix6d>& covariances, double open_variance,
                              std::size_t stride = 1) {
  if (covariances.size() != problem.poses.size()) return std::numeric_limits<double>::infinity();
  const auto cost = CondensedFormulation().make_cost(problem);
  Eigen::VectorXd g;
  Eigen::MatrixXd H;
  LineariseDense(problem, problem.poses, cost.get(), &g, &H);
  const std::vector<HeldSpace> held = HeldSpaces(problem);
  const double largest = H.diagonal().maxCoeff();
  for (std::size_t k = 0; k < held.size(); ++k) {
    if (held[k].cols() == 0) continue;
    const auto i = static_cast<Eigen::Index>(6 * k);
    const Matrix6d keep = Matrix6d::Identity() - held[k] * held[k].transpose();
    H.middleRows<6>(i) = (keep * H.middleRows<6>(i)).eval();
    H.middleCols<6>(i) = (H.middleCols<6>(i) * keep).eval();
    H.block<6, 6>(i, i) += largest * held[k] * held[k].transpose();
  }
  const Eigen::LLT<Eigen::MatrixXd> factor(H);
  double error = 0.0;
  for (std::size_t k = 0; k < held.size(); ++k) {
    if (k % stride != 0 && k + 1 < held.size()) continue;
    const auto i = static_cast<Eigen::Index>(6 * k);
    Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(H.rows(), 6);
    columns.middleRows<6>(i).setIdentity();
    factor.solveInPlace(columns);
    Matrix6d expected = columns.middleRows<6>(i);
    const double open = held[k].cols() == 6 ? 0.0 : open_variance;
    expected += (open - 1.0 / largest) * held[k] * held[k].transpose();
    for (const int part : {0, 3}) {
      const Eigen::Matrix3d e = expected.block<3, 3>(part, part);
      const Eigen::Matrix3d off = covariances[k].block<3, 3>(part, part) - e;
      error = std::max(error, off.norm() / (1e-12 + e.norm()));
    }
  }
  return error;
}

// Frames that are known the worse the farther they are from the held one, each tied to the next by
// a few points: metres at the end. Rounding must not grow along with them.
TEST(PoseCovariances, OfAThinChainAreThoseOfTheDenseInverse) {
  for (const bool ring : {false, true}) {
    for (const int frames : {50, 200}) {
      for (const bool with_open : {false, true}) {
        Scene scene(8);
        scene.points = 20;
        scene.weight = 400.0;
        scene.sigma_m = 0.02;
        AddChain(frames, ring, &scene);
        scene.problem.hold_first_pose = true;
        if (with_open) {
          Vector6d slanted = Vector6d::Ones();
          slanted(4) = -3.0;
          scene.problem.holds = {{frames / 3, slanted}, {frames / 2, Vector6d::Unit(2)}};
        }
        const auto covariances = PoseCovariances(scene.problem, scene.problem.poses, 0.0);
        EXPECT_LT(LargestCovarianceError(scene.problem, covariances, 0.0, 10), 1e-3)
            << frames << " frames, ring " << ring << ", open " << with_open;
      }
    }
  }
}

TEST(PoseCovariances, WithoutGaugeAreUnknownAndSayWhy) {
  for (const int frames : {2, 20, 200}) {
    Scene scene(9);
    AddChain(frames, false, &scene);
    scene.problem.hold_first_pose = false;
    std::string why;
    EXPECT_TRUE(PoseCovariances(scene.problem, scene.problem.poses, 1e6, &why).empty()) << frames;
    EXPECT_NE(why, "");
  }
}

// Frames along a line, of which each sees planes with its neighbours; one is held, of another a
// direction.
TEST(PoseCovariances, OfALineAreThoseOfTheDenseInverse) {
  Draws draws(3);
  BundleProblem problem;
  constexpr int kFrames = 60, kReach = 4, kPlanes = 6;
  for (int k = 0; k < kFrames; ++k) {
    problem.poses.emplace_back(draws.Offset(0.1, 0.0).q, Eigen::Vector3d(0.5 * k, 0, 0));
  }
  for (int p = 0; p < kPlanes * kFrames; ++p) {
    const int at = p / kPlanes;
    const Patch patch(Eigen::Vector3d(0.5 * at, 0, 0) + draws.InCube(3.0), draws.Direction());
    Plane plane;
    plane.first = static_cast<std::int32_t>(problem.observations.size());
    plane.weight = 1e4;
    for (int k = std::max(0, at - kReach); k <= std::min(kFrames - 1, at + kReach); ++k) {
      const SE3 T_lidar_world = problem.poses[static_cast<std::size_t>(k)].Inverse();
      Points seen;
      for (int i = 0; i < 10; ++i) seen.push_back(T_lidar_world * patch.Point(1.0, 0.01, &draws));
      problem.observations.push_back({k, ClusterOf(seen)});
      ++plane.count;
    }
    problem.planes.push_back(plane);
  }
  problem.holds = {{20, Vector6d::Unit(3)}};
  constexpr double kOpenVariance = 1e6;
  const auto covariances = PoseCovariances(problem, problem.poses, kOpenVariance);
  ASSERT_EQ(covariances.size(), problem.poses.size());
  EXPECT_EQ(covariances[0].norm(), 0.0);
  EXPECT_LT(LargestCovarianceError(problem, covariances, kOpenVariance), 1e-6);
  problem.planes[7].weight = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(PoseCovariances(problem, problem.poses, kOpenVariance).empty());
}

}  // namespace
}  // namespace lamina
