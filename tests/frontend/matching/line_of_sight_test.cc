#include "frontend/matching/line_of_sight.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lamina {
namespace {

Surface PlaneOf(double thickness_m, double breadth_m) {
  Surface plane;
  plane.normal = Eigen::Vector3f::UnitZ();
  plane.variance = static_cast<float>(thickness_m * thickness_m);
  plane.flatness = static_cast<float>(std::pow(thickness_m / breadth_m, 2));
  return plane;
}

TEST(LineOfSight, AWallSeenFromTheFrontCountsInFull) {
  EXPECT_GT(SightWeight(PlaneOf(0.02, 0.3), Eigen::Vector3d::UnitZ(), {1.0, 0.0, 5.0}), 0.99);
}

TEST(LineOfSight, ThinGroundAtThirtyMetresStillCounts) {
  const Eigen::Vector3d sight(30.0, 0.0, -1.7);
  EXPECT_GT(SightWeight(PlaneOf(0.008, 0.3), Eigen::Vector3d::UnitZ(), sight), 0.75);
}

TEST(LineOfSight, ASheetOfTheBeamCountsNothing) {
  // In it but for what its thickness turns its normal by.
  const Surface sheet = PlaneOf(0.015, 0.08);
  EXPECT_LT(SightWeight(sheet, Eigen::Vector3d::UnitZ(), {5.0, 3.0, 0.1}), 0.02);
  EXPECT_EQ(SightWeight(sheet, Eigen::Vector3d::UnitZ(), {5.0, 3.0, 0.0}), 0.0);
}

TEST(LineOfSight, NeitherLengthNorSignMatter) {
  const Surface plane = PlaneOf(0.02, 0.2);
  const Eigen::Vector3d sight(3.0, 1.0, -0.4);
  const double weight = SightWeight(plane, Eigen::Vector3d::UnitZ(), sight);
  EXPECT_NEAR(SightWeight(plane, Eigen::Vector3d::UnitZ(), 7.0 * sight), weight, 1e-9);
  EXPECT_NEAR(SightWeight(plane, -Eigen::Vector3d::UnitZ(), sight), weight, 1e-12);
}

TEST(LineOfSight, APointAtTheSensorHasNoWeight) {
  EXPECT_EQ(SightWeight(PlaneOf(0.02, 0.2), Eigen::Vector3d::UnitZ(), Eigen::Vector3d::Zero()),
            0.0);
}

}  // namespace
}  // namespace lamina
