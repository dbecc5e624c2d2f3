#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "tools/synth/engine/movers.h"
#include "tools/synth/motion/motion.h"
#include "tools/synth/motion/route.h"
#include "tools/synth/scenes/indoor.h"
#include "tools/synth/scenes/street.h"

namespace lamina::synth {
namespace {

const Eigen::Vector2d kBlock(kStreetBlockX, kStreetBlockY);

class RouteTest : public ::testing::TestWithParam<RouteKind> {};

TEST_P(RouteTest, HeadingIsTheDirectionOfTravelAndCurvatureItsRate) {
  const Route route(GetParam(), 2, kBlock);
  constexpr double kStep = 1e-4;
  for (double s = -700.0; s < 1500.0; s += 0.731) {
    const RoutePoint a = route.At(s - kStep);
    const RoutePoint b = route.At(s + kStep);
    const RoutePoint p = route.At(s);
    const Eigen::Vector2d direction(std::cos(p.heading), std::sin(p.heading));
    EXPECT_LT(((b.position - a.position) / (2.0 * kStep) - direction).norm(), 1e-4) << "s " << s;
    const double turned = std::remainder(b.heading - a.heading, 2.0 * M_PI);
    EXPECT_NEAR(turned / (2.0 * kStep), p.curvature, 1e-4) << "s " << s;
  }
}

TEST_P(RouteTest, StaysOnTheRoads) {
  const Route route(GetParam(), 1, kBlock);
  for (double s = 0.0; s < 2.0 * route.period_m(); s += 0.5) {
    // The outline of a car in the right lane.
    for (const double side : {-kLaneOffset - 0.95, -kLaneOffset + 0.95}) {
      const Eigen::Vector2d p = route.Beside(s, side, 0.0).position;
      const double from_x_road = std::abs(std::remainder(p.y(), kBlock.y()));
      const double from_y_road = std::abs(std::remainder(p.x(), kBlock.x()));
      EXPECT_LT(std::min(from_x_road, from_y_road), kRoadHalfWidth) << "s " << s;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, RouteTest, ::testing::Values(RouteKind::kWinding, RouteKind::kStraight, RouteKind::kLoop),
    [](const auto& p) { return RouteNames()[static_cast<std::size_t>(p.param)]; });

TEST(Route, LoopComesBackAndTheOthersMoveOn) {
  const Route loop(RouteKind::kLoop, 3, kBlock);
  const double s = 77.0;
  EXPECT_LT((loop.At(s).position - loop.At(s + 5.0 * loop.period_m()).position).norm(), 1e-8);
  const Route winding(RouteKind::kWinding, 2, kBlock);
  const Eigen::Vector2d advance =
      winding.At(s + 5.0 * winding.period_m()).position - winding.At(s).position;
  EXPECT_NEAR(advance.x(), 5.0 * 3.0 * kStreetBlockX, 1e-8);
  EXPECT_NEAR(advance.y(), 0.0, 1e-8);
}

TEST(DriveProfile, DrivesComfortablyAndHalts) {
  const Route route(RouteKind::kWinding, 2, kBlock);
  const DriveProfile drive(route, 10.0);
  double slowest = 1e9;
  double fastest = 0.0;
  for (double t = -20.0; t < drive.period_s() + 20.0; t += 0.01) {
    const double speed = drive.Speed(t);
    slowest = std::min(slowest, speed);
    fastest = std::max(fastest, speed);
    EXPECT_NEAR((drive.Arc(t + 1e-3) - drive.Arc(t - 1e-3)) / 2e-3, speed, 0.03) << "t " << t;
    EXPECT_LT(std::abs(drive.Acceleration(t)), 3.0) << "t " << t;
    EXPECT_LT(speed * speed * std::abs(route.At(drive.Arc(t)).curvature), 4.0) << "t " << t;
  }
  EXPECT_LT(slowest, 0.01);
  EXPECT_GT(fastest, 10.0);
  EXPECT_LT(fastest, 11.5);
  EXPECT_NEAR(drive.Arc(3.0 + 4.0 * drive.period_s()), drive.Arc(3.0) + 4.0 * route.period_m(),
              1e-6);
}

TEST(CarMotion, IsContinuousWithinTheLimitsOfACar) {
  const auto route = std::make_shared<const Route>(RouteKind::kLoop, 1, kBlock);
  const auto drive = std::make_shared<const DriveProfile>(*route, 12.0);
  const CarMotion motion(Terrain(4), route, drive, 4);
  SE3 before = motion.T_scene_lidar(-0.01);
  for (double t = 0.0; t < 60.0; t += 0.01) {
    const SE3 now = motion.T_scene_lidar(t);
    EXPECT_LT((now.t - before.t).norm(), 0.15) << "t " << t;
    EXPECT_LT(RotationAngle(now, before), 0.01) << "t " << t;
    before = now;
  }
}

class IndoorPathTest : public ::testing::TestWithParam<SceneKind> {};

TEST_P(IndoorPathTest, IsContinuousAndKeepsClearOfSurfaces) {
  const SceneKind kind = GetParam();
  std::unique_ptr<SceneModel> model = MakeRoom(1);
  if (kind == SceneKind::kCorridor) model = MakeCorridor();
  if (kind == SceneKind::kStairs) model = MakeStairs(1);
  if (kind == SceneKind::kHall) model = MakeHall(1);
  const SyntheticScene scene(std::move(model), 16);
  const auto path = MakeIndoorPath(kind, 1.0);
  UprightPose before = path->At(-0.01);
  for (double t = 0.0; t < 300.0; t += 0.01) {
    const UprightPose now = path->At(t);
    EXPECT_LT((now.position - before.position).norm(), 0.025) << "t " << t;
    EXPECT_LT(std::abs(now.yaw - before.yaw), 0.06) << "t " << t;
    before = now;
    const SceneView view = scene.ViewAround(now.position, 5.0);
    EXPECT_GT(view.SurfaceDistance(now.position, 1.0), 0.3) << "t " << t;
  }
}

INSTANTIATE_TEST_SUITE_P(All, IndoorPathTest,
                         ::testing::Values(SceneKind::kRoom, SceneKind::kCorridor,
                                           SceneKind::kStairs, SceneKind::kHall),
                         [](const auto& p) {
                           return SceneNames()[static_cast<std::size_t>(p.param)];
                         });

// A car that is left behind comes again from ahead: it may jump only where no sensor sees it.
TEST(Movers, TrafficJumpsOnlyOutOfSight) {
  const auto route = std::make_shared<const Route>(RouteKind::kStraight, 1, kBlock);
  const auto drive = std::make_shared<const DriveProfile>(*route, 10.0);
  const std::vector<Mover> movers = MakeTraffic(16, Terrain(2), route, drive, 10.0, 2);
  ASSERT_EQ(movers.size(), 16u);
  for (const Mover& mover : movers) {
    UprightPose before = mover.At(0.0);
    for (double t = 0.05; t < 100.0; t += 0.05) {
      const UprightPose now = mover.At(t);
      const Eigen::Vector2d sensor = route->Beside(drive->Arc(t), -kLaneOffset, 0.0).position;
      const double away = (now.position.head<2>() - sensor).norm();
      const double jump = (now.position - before.position).norm();
      EXPECT_TRUE(jump < 1.5 || away > 125.0) << "t " << t;
      EXPECT_GT(away, 3.0) << "t " << t;
      before = now;
    }
  }
}

}  // namespace
}  // namespace lamina::synth
