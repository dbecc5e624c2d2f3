#include "backend/bundle/uncertainty/pose_covariance.h"

#include <gtest/gtest.h>

#include "backend/bundle/formulations/registry.h"
#include "tests/support/scenes/random_bundles.h"

namespace lamina {
namespace {

TEST(PoseCovariances, AreThoseOfTheDenseInverse) {
  Draws draws(9);
  BundleSceneOptions options;
  options.poses = 5;
  options.sigma_m = 0.01;
  options.weight = 1e4;
  BundleScene scene = MakeBundleScene(options, &draws);
  const std::vector<Matrix6d> covariances =
      PoseCovariances(scene.problem, scene.problem.poses, 1e6);
  const auto cost = CondensedFormulation().make_cost(scene.problem);
  Eigen::VectorXd g;
  Eigen::MatrixXd H;
  LineariseDense(scene.problem, scene.problem.poses, cost.get(), &g, &H);
  const Eigen::MatrixXd inverse = Eigen::MatrixXd(H.bottomRightCorner(24, 24)).inverse();
  EXPECT_EQ(covariances[0].norm(), 0.0);
  for (int k = 1; k < 5; ++k) {
    const Matrix6d expected = inverse.block<6, 6>(6 * (k - 1), 6 * (k - 1));
    EXPECT_LT((covariances[static_cast<std::size_t>(k)] - expected).norm(), 1e-6 * expected.norm());
  }
}

}  // namespace
}  // namespace lamina
