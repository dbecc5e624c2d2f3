#include "backend/bundle/condensed_cost.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <stdexcept>

#include "tests/support/scenes/random_bundles.h"

namespace lamina {
namespace {

BundleSceneOptions SmallScene() {
  BundleSceneOptions options;
  options.poses = 4;
  options.planes = 6;
  options.points = 12;
  options.seen_share = 0.8;
  options.sigma_m = 0.05;
  options.weight = 7.0;
  return options;
}

// Normal and offset of the plane that fits points best, by a singular value decomposition.
struct FittedPlane {
  Eigen::Vector3d u1, u2, normal;
  double offset = 0.0;
  double residual2 = 0.0;  // sum of squared distances
};

FittedPlane FitPlane(const Points& points) {
  Eigen::MatrixX3d rows(static_cast<Eigen::Index>(points.size()), 3);
  for (std::size_t i = 0; i < points.size(); ++i) {
    rows.row(static_cast<Eigen::Index>(i)) = points[i].transpose();
  }
  const Eigen::Vector3d mean = rows.colwise().mean().transpose();
  rows.rowwise() -= mean.transpose();
  const Eigen::Matrix3d scatter = rows.transpose() * rows;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(scatter, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d v = svd.matrixV();
  return {v.col(0), v.col(1), v.col(2), v.col(2).dot(mean), (rows * v.col(2)).squaredNorm()};
}

double BruteForceCost(const BundleScene& scene, const std::vector<SE3>& poses) {
  double cost = 0.0;
  for (const Plane& plane : scene.problem.planes) {
    cost += 0.5 * plane.weight * FitPlane(PointsOfPlane(scene, plane, poses).world).residual2;
  }
  return cost;
}

double CondensedDense(const BundleProblem& problem, const std::vector<SE3>& poses,
                      Eigen::VectorXd* g, Eigen::MatrixXd* H) {
  CondensedCost cost(problem);
  return LineariseDense(problem, poses, &cost, g, H);
}

// Residuals of the points of a plane with the fitted plane turned by (a, b) and shifted by d.
Eigen::VectorXd Residuals(const BundleScene& scene, const Plane& plane,
                          const std::vector<SE3>& poses, const FittedPlane& fit,
                          const Eigen::Vector3d& abd) {
  const Points points = PointsOfPlane(scene, plane, poses).world;
  const Eigen::Vector3d normal = (fit.normal + abd(0) * fit.u1 + abd(1) * fit.u2).normalized();
  Eigen::VectorXd r(static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    r(static_cast<Eigen::Index>(i)) = normal.dot(points[i]) - fit.offset - abd(2);
  }
  return r;
}

// J'J - J'P (P'P)^-1 P'J of one plane, J and P by central differences over the points.
Eigen::MatrixXd NumericReducedHessian(const BundleScene& scene, const Plane& plane,
                                      const std::vector<SE3>& poses) {
  constexpr double kStep = 1e-6;
  const FittedPlane fit = FitPlane(PointsOfPlane(scene, plane, poses).world);
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  const Eigen::VectorXd r = Residuals(scene, plane, poses, fit, none);
  Eigen::MatrixXd J(r.size(), 6 * static_cast<Eigen::Index>(poses.size()));
  for (Eigen::Index c = 0; c < J.cols(); ++c) {
    J.col(c) = (Residuals(scene, plane, Retracted(poses, c, kStep), fit, none) -
                Residuals(scene, plane, Retracted(poses, c, -kStep), fit, none)) /
               (2.0 * kStep);
  }
  Eigen::MatrixXd P(r.size(), 3);
  for (int c = 0; c < 3; ++c) {
    const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(c);
    P.col(c) =
        (Residuals(scene, plane, poses, fit, step) - Residuals(scene, plane, poses, fit, -step)) /
        (2.0 * kStep);
  }
  const Eigen::MatrixXd JtP = J.transpose() * P;
  return plane.weight *
         (J.transpose() * J - JtP * (P.transpose() * P).ldlt().solve(JtP.transpose()));
}

TEST(CondensedCost, IsTheSumOverAllPointsToTheirBestPlanes) {
  Draws draws(1);
  for (int i = 0; i < 50; ++i) {
    const BundleScene scene = MakeBundleScene(SmallScene(), &draws);
    CondensedCost cost(scene.problem);
    for (const std::vector<SE3>& poses : {scene.problem.poses, scene.truth}) {
      const double expected = BruteForceCost(scene, poses);
      EXPECT_NEAR(cost.Value(poses), expected, 1e-10 * expected);
      Eigen::VectorXd g;
      Eigen::MatrixXd H;
      EXPECT_NEAR(LineariseDense(scene.problem, poses, &cost, &g, &H), expected, 1e-10 * expected);
      EXPECT_LE(EigenvalueLowerBound(scene.problem), expected);
      EXPECT_GT(EigenvalueLowerBound(scene.problem), 0.0);
    }
  }
}

TEST(CondensedCost, GradientMeetsNumericDifferences) {
  Draws draws(2);
  for (int i = 0; i < 20; ++i) {
    const BundleScene scene = MakeBundleScene(SmallScene(), &draws);
    const BundleProblem problem =
        i % 2 == 0 ? scene.problem : Marginalised(scene.problem, 1, scene.problem.poses);
    CondensedCost cost(problem);
    Eigen::VectorXd g;
    Eigen::MatrixXd H;
    LineariseDense(problem, problem.poses, &cost, &g, &H);
    Eigen::VectorXd numeric(g.size());
    constexpr double kStep = 1e-5;
    for (Eigen::Index c = 0; c < g.size(); ++c) {
      numeric(c) = (cost.Value(Retracted(problem.poses, c, kStep)) -
                    cost.Value(Retracted(problem.poses, c, -kStep))) /
                   (2.0 * kStep);
    }
    EXPECT_GT(g.norm(), 1.0);
    EXPECT_LT((g - numeric).norm(), 1e-6 * g.norm());
  }
}

TEST(CondensedCost, HessianIsThatOfThePointsWithThePlanesEliminated) {
  Draws draws(3);
  for (int i = 0; i < 20; ++i) {
    const BundleScene scene = MakeBundleScene(SmallScene(), &draws);
    const std::vector<SE3>& poses = scene.problem.poses;
    Eigen::VectorXd g;
    Eigen::MatrixXd H;
    CondensedDense(scene.problem, poses, &g, &H);
    Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(H.rows(), H.cols());
    for (const Plane& plane : scene.problem.planes) {
      expected += NumericReducedHessian(scene, plane, poses);
    }
    EXPECT_LT((H - expected).norm(), 1e-6 * expected.norm());
  }
}

TEST(CondensedCost, HessianIsSymmetricAndPositiveSemiDefinite) {
  Draws draws(4);
  for (int i = 0; i < 100; ++i) {
    BundleSceneOptions options = SmallScene();
    options.points = draws.Integer(1, 12);
    options.planes = draws.Integer(1, 6);
    options.start_rotation_deg = 20.0;
    const BundleScene scene = MakeBundleScene(options, &draws);
    Eigen::VectorXd g;
    Eigen::MatrixXd H;
    CondensedDense(scene.problem, scene.problem.poses, &g, &H);
    EXPECT_EQ((H - H.transpose()).norm(), 0.0);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(H, Eigen::EigenvaluesOnly);
    EXPECT_GE(solver.eigenvalues().minCoeff(),
              -1e-12 * (solver.eigenvalues().maxCoeff() + options.weight));
    EXPECT_TRUE(g.allFinite());
  }
}

TEST(CondensedCost, MovingEverythingTogetherCostsNothing) {
  Draws draws(5);
  const BundleScene scene = MakeBundleScene(SmallScene(), &draws);
  CondensedCost cost(scene.problem);
  const double before = cost.Value(scene.problem.poses);
  const SE3 T = draws.Pose(10.0);
  std::vector<SE3> moved;
  for (const SE3& pose : scene.problem.poses) moved.push_back(T * pose);
  EXPECT_NEAR(cost.Value(moved), before, 1e-9 * before);
}

TEST(CondensedCost, EqualsThePapersSumWithExactWeights) {
  Draws draws(6);
  for (int i = 0; i < 50; ++i) {
    const BundleScene scene = MakeBundleScene(SmallScene(), &draws);
    const std::vector<SE3>& poses = scene.problem.poses;
    double sum = 0.0;
    for (const Plane& plane : scene.problem.planes) {
      const PointCluster all = AggregatePlane(scene.problem, plane, poses);
      const Eigen::Vector3d normal = all.EigenPairs().u.col(2);
      for (int o = plane.first; o < plane.first + plane.count; ++o) {
        const PlaneObservation& seen = scene.problem.observations[static_cast<std::size_t>(o)];
        const SE3& T = poses[static_cast<std::size_t>(seen.frame)];
        const Eigen3 e = seen.cluster.EigenPairs();
        const Eigen::Vector3d along = e.u.transpose() * (T.R().transpose() * normal);
        const double to_mean = normal.dot(T * seen.cluster.mean - all.mean);
        // Eq. 10 with (l1 - l3, l2 - l3) in place of (l1, l2).
        sum += 0.5 * plane.weight * seen.cluster.count *
               ((e.l(0) - e.l(2)) * along(0) * along(0) + (e.l(1) - e.l(2)) * along(1) * along(1) +
                to_mean * to_mean);
      }
    }
    CondensedCost cost(scene.problem);
    EXPECT_NEAR(sum, cost.Value(poses) - EigenvalueLowerBound(scene.problem),
                1e-10 * cost.Value(poses));
  }
}

TEST(CondensedCost, HasTheSameBitsAtAnyNumberOfThreads) {
  Draws draws(7);
  BundleSceneOptions options = SmallScene();
  options.planes = 1000;
  const BundleScene scene = MakeBundleScene(options, &draws);
  CondensedCost cost(scene.problem);
  Eigen::VectorXd g, g1;
  Eigen::MatrixXd H, H1;
  double cost1 = 0.0, value1 = 0.0;
  for (const std::size_t threads : {1U, 2U, 4U, 4U}) {
    const ThreadLimit limit(threads);
    const double c = LineariseDense(scene.problem, scene.problem.poses, &cost, &g, &H);
    const double value = cost.Value(scene.problem.poses);
    if (threads == 1) {
      cost1 = c;
      value1 = value;
      g1 = g;
      H1 = H;
    }
    EXPECT_EQ(c, cost1);
    EXPECT_EQ(value, value1);
    EXPECT_TRUE(g == g1) << threads << " threads";
    EXPECT_TRUE(H == H1) << threads << " threads";
  }
}

// The rows of some planes at a time: the same sums in the same order.
TEST(CondensedCost, HessianInPartsHasTheSameBits) {
  Draws draws(9);
  BundleSceneOptions options;
  options.poses = 30;
  options.planes = 200;
  options.points = 8;
  options.seen_share = 0.2;
  const BundleScene scene = MakeBundleScene(options, &draws);
  const BundleIndex index(scene.problem);
  const BlockPattern pattern(scene.problem, index);
  CondensedCost cost(scene.problem);
  ReducedSystem whole, parts;
  Eigen::SparseMatrix<double> expected, H;
  cost.Linearise(scene.problem.poses, &whole);
  whole.Assemble(scene.problem, index, pattern, &expected);
  cost.LineariseWithoutRows(scene.problem.poses, &parts);
  EXPECT_TRUE(parts.rows.empty());
  EXPECT_EQ(parts.cost, whole.cost);
  EXPECT_EQ(parts.gradient, whole.gradient);
  for (const std::size_t observations : {1U, 100U, 100000U}) {
    parts.AssembleInParts(scene.problem, index, pattern, cost, observations, &H);
    EXPECT_EQ((Eigen::MatrixXd(H) - Eigen::MatrixXd(expected)).norm(), 0.0) << observations;
  }
}

TEST(CondensedCost, FixedClustersActAsFramesThatCannotMove) {
  Draws draws(8);
  for (int i = 0; i < 20; ++i) {
    const BundleScene scene = MakeBundleScene(SmallScene(), &draws);
    const BundleProblem rest = Marginalised(scene.problem, 2, scene.problem.poses);
    Eigen::VectorXd g, g_rest;
    Eigen::MatrixXd H, H_rest;
    const double cost = CondensedDense(scene.problem, scene.problem.poses, &g, &H);
    EXPECT_NEAR(CondensedDense(rest, rest.poses, &g_rest, &H_rest), cost, 1e-10 * cost);
    EXPECT_LT((g_rest - g.tail(g_rest.size())).norm(), 1e-9 * g.norm());
    EXPECT_LT((H_rest - H.bottomRightCorner(g_rest.size(), g_rest.size())).norm(), 1e-9 * H.norm());
  }
}

// What was found out at some poses is used again there, and nowhere else.
TEST(CondensedCost, DoesNotDependOnWhereItWasAskedBefore) {
  Draws draws(10);
  const BundleScene scene = MakeBundleScene(SmallScene(), &draws);
  const auto fresh = [&](const std::vector<SE3>& poses, ReducedSystem* system) {
    CondensedCost(scene.problem).Linearise(poses, system);
  };
  CondensedCost cost(scene.problem);
  std::vector<SE3> poses = scene.problem.poses;
  for (int i = 0; i < 5; ++i) {
    ReducedSystem expected, system;
    fresh(poses, &expected);
    EXPECT_EQ(cost.Value(poses), expected.cost);
    cost.Linearise(poses, &system);
    EXPECT_EQ(system.cost, expected.cost);
    EXPECT_EQ(system.gradient, expected.gradient);
    EXPECT_EQ(system.diagonal, expected.diagonal);
    EXPECT_EQ(system.rows, expected.rows);
    ReducedSystem gradient;
    cost.FindGradient(poses, &gradient);
    EXPECT_EQ(gradient.cost, expected.cost);
    EXPECT_LT((gradient.gradient - expected.gradient).norm(), 1e-12 * expected.gradient.norm());
    cost.LineariseWithoutRows(poses, &gradient);
    EXPECT_EQ(gradient.gradient, expected.gradient);
    EXPECT_EQ(gradient.diagonal, expected.diagonal);
    for (std::size_t p = 0; p < scene.problem.planes.size(); ++p) {
      const Plane& plane = scene.problem.planes[p];
      ReducedSystem::Rows rows[8];
      ASSERT_LE(plane.count, 8);
      cost.MakeRows(p, rows);
      for (int k = 0; k < plane.count; ++k) {
        EXPECT_EQ(rows[k], expected.rows[static_cast<std::size_t>(plane.first + k)]);
      }
    }
    poses[1].t.x() += 1e-3;
    cost.Value(poses);
    ReducedSystem::Rows none[8];
    EXPECT_THROW(cost.MakeRows(0, none), std::logic_error);
  }
}

TEST(CondensedCost, RefusesObservationsOfPosesThatDoNotExist) {
  Draws draws(9);
  BundleScene scene = MakeBundleScene(SmallScene(), &draws);
  EXPECT_NO_THROW(CondensedCost{scene.problem});
  scene.problem.observations.back().frame = 4;
  EXPECT_THROW(CondensedCost{scene.problem}, std::logic_error);
  scene.problem.observations.back().frame = -1;
  EXPECT_THROW(CondensedCost{scene.problem}, std::logic_error);
}

TEST(CondensedCost, OfNothingIsZero) {
  BundleProblem problem;
  problem.poses.resize(3);
  Eigen::VectorXd g;
  Eigen::MatrixXd H;
  EXPECT_EQ(CondensedDense(problem, problem.poses, &g, &H), 0.0);
  EXPECT_EQ(g.size(), 18);
  EXPECT_EQ(H.norm(), 0.0);
}

}  // namespace
}  // namespace lamina
