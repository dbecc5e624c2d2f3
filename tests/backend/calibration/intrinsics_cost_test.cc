#include "backend/calibration/intrinsics_cost.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "backend/bundle/condensed_cost.h"
#include "backend/bundle/plane_geometry.h"
#include "tests/support/scenes/random_bundles.h"

namespace lamina {
namespace {

Eigen::Vector3d Moved(const Eigen::Vector3d& p, const Intrinsics& offsets) {
  const Eigen::Vector3d axis = p.cross(Eigen::Vector3d::UnitZ()).normalized();
  const Eigen::Vector3d turned = Eigen::AngleAxisd(offsets(0), axis) * p;
  return turned * (1.0 + offsets(1) / p.norm());
}

// The scene with its points, and so its clusters, moved.
BundleScene MovedScene(BundleScene scene, const Intrinsics& offsets) {
  for (std::size_t o = 0; o < scene.points.size(); ++o) {
    for (Eigen::Vector3d& p : scene.points[o]) p = Moved(p, offsets);
    scene.problem.observations[o].cluster = ClusterOf(scene.points[o]);
  }
  return scene;
}

// Small patches, so that the fields are linear over a cluster.
BundleScene SmallPatches(Draws* draws) {
  BundleSceneOptions options;
  options.poses = 4;
  options.planes = 12;
  options.points = 12;
  options.seen_share = 0.8;
  options.sigma_m = 0.01;
  options.weight = 7.0;
  options.start_rotation_deg = 0.2;
  options.start_translation_m = 0.01;
  options.patch_m = 0.02;
  return MakeBundleScene(options, draws);
}

TEST(SensorIntrinsics, FieldsAreTheDerivativesOfMovedPoints) {
  Draws draws(1);
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p = draws.InCube(20.0);
    const IntrinsicsField field = IntrinsicsFieldAt(p);
    const IntrinsicsFieldJacobians F = IntrinsicsFieldJacobiansAt(p);
    for (int k = 0; k < 2; ++k) {
      const Intrinsics step = kStep * Intrinsics::Unit(k);
      const Eigen::Vector3d numeric = (Moved(p, step) - Moved(p, -step)) / (2.0 * kStep);
      EXPECT_LT((numeric - field.col(k)).norm(), 1e-6 * (1.0 + p.norm()));
      for (int c = 0; c < 3; ++c) {
        const Eigen::Vector3d d = kStep * Eigen::Vector3d::Unit(c);
        const Eigen::Vector3d by_p =
            (IntrinsicsFieldAt(p + d).col(k) - IntrinsicsFieldAt(p - d).col(k)) / (2.0 * kStep);
        const Eigen::Matrix3d& jacobian = k == 0 ? F.elevation : F.range;
        EXPECT_LT((by_p - jacobian.col(c)).norm(), 1e-6 * (1.0 + p.norm() / p.head<2>().norm()));
      }
    }
  }
}

TEST(SensorIntrinsics, ClustersMoveAsTheirPointsDo) {
  Draws draws(2);
  const Intrinsics offsets(0.01, 0.05);
  for (int i = 0; i < 100; ++i) {
    const Points points = draws.Cloud(30, 15.0 * draws.Direction() + Eigen::Vector3d(3, 3, 0), 0.2);
    if (ClusterOf(points).mean.head<2>().norm() < 3.0) continue;
    Points moved;
    for (const Eigen::Vector3d& p : points) moved.push_back(Moved(p, offsets));
    TimedCluster cluster;
    cluster.points = ClusterOf(points);
    const PointCluster corrected = Corrected({cluster}, offsets).front().points;
    const PointCluster expected = ClusterOf(moved);
    EXPECT_LT((corrected.mean - expected.mean).norm(), 2e-4);
    EXPECT_LT((corrected.scatter.Dense() - expected.scatter.Dense()).norm(),
              1e-3 * expected.scatter.Trace());
  }
}

TEST(IntrinsicsCost, GradientMeetsNumericDifferences) {
  Draws draws(3);
  for (int i = 0; i < 10; ++i) {
    const BundleScene scene = SmallPatches(&draws);
    // Without the poses: all of them held.
    BundleProblem problem = scene.problem;
    for (int k = 0; k < 4; ++k) {
      for (int d = 0; d < 6; ++d) problem.holds.push_back({k, Vector6d::Unit(d)});
    }
    const IntrinsicsSystem system = LineariseIntrinsics(problem, problem.poses);
    const Eigen::Vector2d steps(1e-5, 1e-4);
    Eigen::Vector2d numeric;
    for (int k = 0; k < 2; ++k) {
      const Intrinsics step = steps(k) * Intrinsics::Unit(k);
      numeric(k) = (EigenvalueCost(MovedScene(scene, step).problem, problem.poses) -
                    EigenvalueCost(MovedScene(scene, -step).problem, problem.poses)) /
                   (2.0 * steps(k));
    }
    EXPECT_NEAR(system.g(0), numeric(0), 2e-3 * numeric.cwiseAbs().maxCoeff() + 1e-3);
    EXPECT_NEAR(system.g(1), numeric(1), 2e-3 * numeric.cwiseAbs().maxCoeff() + 1e-3);
    EXPECT_NEAR(system.cost, EigenvalueCost(problem, problem.poses), 1e-9 * system.cost);
  }
}

// One step of the two unknowns and the poses that follow finds offsets that were put in.
TEST(IntrinsicsCost, AStepFindsTheOffsetsAndThePoses) {
  Draws draws(4);
  BundleSceneOptions options;
  options.poses = 6;
  options.planes = 40;
  options.points = 12;
  options.start_rotation_deg = 0.0;
  options.start_translation_m = 0.0;
  options.patch_m = 0.3;
  const BundleScene exact = MakeBundleScene(options, &draws);
  const Intrinsics put_in(-2e-4, -2e-3);
  const BundleScene scene = MovedScene(exact, put_in);
  const IntrinsicsSystem system = LineariseIntrinsics(scene.problem, scene.problem.poses);
  const Intrinsics found = -system.H.inverse() * system.g;
  EXPECT_NEAR(found(0), 2e-4, 4e-6);
  EXPECT_NEAR(found(1), 2e-3, 4e-5);
  // The poses were the true ones, and are so again.
  const Eigen::VectorXd pose_step = system.pose_step + system.pose_slope * found;
  EXPECT_LT(pose_step.cwiseAbs().maxCoeff(), 1e-4);
}

TEST(IntrinsicsCost, TheGradientByElevationSumsToTheGradient) {
  Draws draws(5);
  const BundleScene scene = SmallPatches(&draws);
  const IntrinsicsSystem system = LineariseIntrinsics(scene.problem, scene.problem.poses);
  const Eigen::Vector2d sum = system.g_by_elevation.rowwise().sum();
  // Also away from the optimum of the poses: their own gradient is answered to first order.
  EXPECT_LT((sum - system.g).norm(), 1e-6 * (1.0 + system.g_by_elevation.norm()));
}

}  // namespace
}  // namespace lamina
