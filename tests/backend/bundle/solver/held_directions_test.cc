#include "backend/bundle/solver/held_directions.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "backend/bundle/condensed_cost.h"
#include "backend/bundle/solver/adjuster.h"
#include "tests/support/scenes/random_bundles.h"

namespace lamina {
namespace {

// A bundle in which some frames are held: one as a whole, one along two directions, one along one.
BundleScene HeldScene(Draws* draws) {
  BundleSceneOptions options;
  options.poses = 6;
  options.sigma_m = 0.01;
  BundleScene scene = MakeBundleScene(options, draws);
  scene.problem.hold_first_pose = true;
  const auto hold = [&](int frame) {
    Vector6d direction;
    direction << draws->Direction(), draws->Direction();
    scene.problem.holds.push_back({frame, direction});
  };
  hold(2);
  hold(2);
  hold(4);
  return scene;
}

// Columns that span all motions that are not held.
Eigen::MatrixXd FreeMotions(const HeldDirections& held, Eigen::Index size) {
  Eigen::MatrixXd P = Eigen::MatrixXd::Identity(size, size);
  for (const HeldDirections::Frame& f : held.frames()) {
    const auto i = static_cast<Eigen::Index>(6 * f.frame);
    P.block<6, 6>(i, i) = f.projector;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(P);
  const auto free = static_cast<Eigen::Index>((eigen.eigenvalues().array() > 0.5).count());
  return eigen.eigenvectors().rightCols(free);
}

TEST(HeldDirections, TheSolutionIsThatAmongTheFreeMotions) {
  Draws draws(1);
  for (int run = 0; run < 20; ++run) {
    const BundleScene scene = HeldScene(&draws);
    CondensedCost cost(scene.problem);
    ReducedSystem system;
    cost.Linearise(scene.problem.poses, &system);
    const BundleIndex index(scene.problem);
    Eigen::MatrixXd H;
    system.Assemble(scene.problem, index, &H);
    H.diagonal().array() += 1e-6 * H.diagonal().maxCoeff();
    const HeldDirections held(scene.problem);
    ASSERT_EQ(held.frames().size(), 3U);
    const Eigen::MatrixXd Z = FreeMotions(held, H.cols());
    ASSERT_EQ(Z.cols(), H.cols() - 6 - 2 - 1);
    const Eigen::VectorXd expected =
        -Z * (Z.transpose() * H * Z).llt().solve(Z.transpose() * system.gradient);
    Eigen::MatrixXd without = H;
    held.TakeOut(&without);
    Eigen::VectorXd gradient = system.gradient;
    held.Project(&gradient);
    const Eigen::VectorXd step = -without.llt().solve(gradient);
    EXPECT_LT((step - expected).norm(), 1e-9 * expected.norm());
    EXPECT_EQ(step.head<6>().norm(), 0.0);
  }
}

TEST(HeldDirections, OfASparseMatrixAsOfADenseOne) {
  Draws draws(2);
  const BundleScene scene = HeldScene(&draws);
  CondensedCost cost(scene.problem);
  ReducedSystem system;
  cost.Linearise(scene.problem.poses, &system);
  const BundleIndex index(scene.problem);
  const HeldDirections held(scene.problem);
  Eigen::MatrixXd dense;
  system.Assemble(scene.problem, index, &dense);
  held.TakeOut(&dense);
  Eigen::SparseMatrix<double> H;
  const BlockPattern pattern(scene.problem, index);
  system.Assemble(scene.problem, index, pattern, &H);
  held.TakeOut(pattern, &H);
  const Eigen::MatrixXd all = Eigen::MatrixXd(H).selfadjointView<Eigen::Upper>();
  EXPECT_LT((all - dense).norm(), 1e-12 * dense.norm());
}

TEST(HeldDirections, OfFramesThatDecoupleAsOfADenseMatrix) {
  Draws draws(4);
  const BundleScene scene = HeldScene(&draws);
  const HeldDirections held(scene.problem);
  const std::size_t frames = scene.problem.poses.size();
  std::vector<Matrix6d> blocks;
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(6 * static_cast<Eigen::Index>(frames),
                                                6 * static_cast<Eigen::Index>(frames));
  for (std::size_t k = 0; k < frames; ++k) {
    const Matrix6d half = Matrix6d::Random();
    blocks.push_back(half * half.transpose());
    const auto i = static_cast<Eigen::Index>(6 * k);
    dense.block<6, 6>(i, i) = blocks.back();
  }
  held.TakeOut(&blocks);
  held.TakeOut(&dense);
  for (std::size_t k = 0; k < frames; ++k) {
    const auto i = static_cast<Eigen::Index>(6 * k);
    EXPECT_LT((dense.block<6, 6>(i, i) - blocks[k]).norm(), 1e-12 * dense.norm());
  }
}

// Nothing held moves in an adjustment, and what is free comes to rest.
TEST(HeldDirections, AnAdjustmentKeepsOutOfThem) {
  Draws draws(3);
  const BundleScene scene = HeldScene(&draws);
  const BundleResult result = AdjustBundle(scene.problem, {});
  ASSERT_EQ(result.status, BundleResult::Status::kConverged);
  EXPECT_EQ((result.poses[0].t - scene.problem.poses[0].t).norm(), 0.0);
  CondensedCost cost(scene.problem);
  ReducedSystem system;
  cost.Linearise(result.poses, &system);
  const HeldDirections held(scene.problem);
  Eigen::VectorXd gradient = system.gradient;
  held.Project(&gradient);
  EXPECT_LT(gradient.norm(), 1e-3 * system.gradient.norm());
}

TEST(HeldSpaces, SpanWhatIsHeldAndNoMore) {
  BundleProblem problem;
  problem.poses.resize(3);
  Vector6d a = Vector6d::Zero(), b = Vector6d::Zero();
  a << 1, 1, 0, 0, 0, 0;
  b << 1, 0, 0, 2, 0, 0;
  problem.holds = {{1, a}, {1, b}, {1, Vector6d(a + 3.0 * b)}};
  const std::vector<HeldSpace> held = HeldSpaces(problem);
  EXPECT_EQ(held[0].cols(), 6);
  ASSERT_EQ(held[1].cols(), 2);
  EXPECT_EQ(held[2].cols(), 0);
  EXPECT_LT((held[1].transpose() * held[1] - Eigen::Matrix2d::Identity()).norm(), 1e-12);
  for (const Vector6d& v : {a, b}) {
    EXPECT_LT((v - held[1] * (held[1].transpose() * v)).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace lamina
