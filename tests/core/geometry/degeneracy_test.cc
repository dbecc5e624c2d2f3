#include "core/geometry/degeneracy.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

constexpr double kMaxSigmaM = 0.05;
constexpr double kMinFacing = 6.0;

// Residuals of planes with this normal, met at 10 m, each known to sigma_m.
void Face(const Eigen::Vector3d& normal, int count, double sigma_m, DirectionEvidence* evidence) {
  Vector6d j;
  j << Eigen::Vector3d::Zero(), normal;
  for (int i = 0; i < count; ++i) {
    evidence->Add(j, 1.0 / (sigma_m * sigma_m), NormalError2(0.0004, 0.16, 0.0),
                  10.0 / kRotationArmM, 1.0);
  }
}

TEST(Degeneracy, GoodDataOnOtherDirectionsChangesNothing) {
  DirectionEvidence evidence;
  Face(Eigen::Vector3d::UnitX(), 40, 0.05, &evidence);
  const double sigma = evidence.Sigma(3);
  EXPECT_NEAR(sigma, 0.05 / std::sqrt(40.0), 1e-3);
  EXPECT_FALSE(evidence.Degenerate(3, kMaxSigmaM, kMinFacing));
  Face(Eigen::Vector3d::UnitY(), 1000000, 0.01, &evidence);
  Face(Eigen::Vector3d::UnitZ(), 1000000, 0.01, &evidence);
  EXPECT_EQ(evidence.Sigma(3), sigma);
  EXPECT_FALSE(evidence.Degenerate(3, kMaxSigmaM, kMinFacing));
}

TEST(Degeneracy, WrongNormalsFeignNothing) {
  // Walls along x whose normals err by up to 2 degrees.
  DirectionEvidence evidence;
  Draws draws(1);
  for (int i = 0; i < 5000; ++i) {
    const double tilt = draws.Uniform(-0.035, 0.035);
    Face({std::sin(tilt), std::cos(tilt), 0.0}, 1, 0.02, &evidence);
  }
  EXPECT_TRUE(evidence.Degenerate(3, kMaxSigmaM, kMinFacing));
  EXPECT_FALSE(evidence.Degenerate(4, kMaxSigmaM, kMinFacing));
}

TEST(Degeneracy, FewClustersAreTooFewHoweverSure) {
  DirectionEvidence evidence;
  Face(Eigen::Vector3d::UnitX(), 4, 0.001, &evidence);
  EXPECT_LT(evidence.Sigma(3), kMaxSigmaM);
  EXPECT_NEAR(evidence.Facing(3), 4.0, 1e-9);
  EXPECT_TRUE(evidence.Degenerate(3, kMaxSigmaM, kMinFacing));
  EXPECT_TRUE(std::isinf(evidence.Sigma(4)));
  EXPECT_TRUE(evidence.Degenerate(4, kMaxSigmaM, kMinFacing));
}

}  // namespace
}  // namespace lamina
