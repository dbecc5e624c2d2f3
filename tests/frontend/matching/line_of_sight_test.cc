#include "frontend/matching/line_of_sight.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

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

// The scatter about their mean of points that rings of these elevations draw on the floor 1.7 m
// below the sensor, or on a wall 5 m ahead of it, within 3 degrees.
struct Drawn {
  Symmetric3 scatter;
  Eigen::Vector3d mean;
};
Drawn DrawnBy(const std::vector<double>& elevations_deg, bool on_floor) {
  std::vector<Eigen::Vector3d> points;
  for (const double elevation_deg : elevations_deg) {
    const double e = elevation_deg * M_PI / 180.0;
    for (int i = -10; i <= 10; ++i) {
      const double azimuth = 0.7 + i * 0.3 * M_PI / 180.0;
      const Eigen::Vector3d beam(std::cos(e) * std::cos(azimuth), std::cos(e) * std::sin(azimuth),
                                 std::sin(e));
      points.push_back(beam * (on_floor ? -1.7 / beam.z() : 5.0 / beam.x()));
    }
  }
  Drawn drawn{{}, Eigen::Vector3d::Zero()};
  for (const Eigen::Vector3d& p : points) drawn.mean += p / static_cast<double>(points.size());
  for (const Eigen::Vector3d& p : points) drawn.scatter.AddOuter(1.0, p - drawn.mean);
  return drawn;
}

TEST(LineOfSight, OneRingIsToldFromTwo) {
  for (const bool on_floor : {true, false}) {
    const Drawn one = DrawnBy({-10.0}, on_floor), two = DrawnBy({-10.0, -8.0}, on_floor);
    EXPECT_TRUE(OnOneRing(one.scatter, Eigen::Matrix3d::Identity(), one.mean)) << on_floor;
    EXPECT_FALSE(OnOneRing(two.scatter, Eigen::Matrix3d::Identity(), two.mean)) << on_floor;
  }
}

TEST(LineOfSight, OneRingIsKnownInAnyFrame) {
  const Drawn drawn = DrawnBy({-10.0}, false);
  const Eigen::Matrix3d R =
      Eigen::AngleAxisd(1.1, Eigen::Vector3d(1.0, 2.0, -1.0).normalized()).toRotationMatrix();
  EXPECT_TRUE(OnOneRing(drawn.scatter.Rotated(R), R, drawn.mean));
  EXPECT_FALSE(OnOneRing(drawn.scatter.Rotated(R), Eigen::Matrix3d::Identity(), drawn.mean));
}

TEST(LineOfSight, APoleAndASinglePointAreOnNoRing) {
  Symmetric3 pole;
  pole.AddOuter(1.0, Eigen::Vector3d::UnitZ());
  EXPECT_FALSE(OnOneRing(pole, Eigen::Matrix3d::Identity(), {5.0, 2.0, 0.0}));
  EXPECT_FALSE(OnOneRing(Symmetric3(), Eigen::Matrix3d::Identity(), {5.0, 2.0, 0.0}));
}

}  // namespace
}  // namespace lamina
