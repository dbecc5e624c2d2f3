#include "backend/pieces/open_poses.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace lamina {
namespace {

constexpr StampNs kPeriodNs = 100'000'000, kMiddleNs = 50'000'000;
constexpr double kSpeedMS = 3.0;

SE3 TrueAt(StampNs stamp_ns) {
  return SE3(Eigen::Quaterniond::Identity(), {kSpeedMS * SecondsBetween(0, stamp_ns), 0.0, 0.0});
}

// Scan number k along x, registered in the middle of its sweep, during which it seems to move so.
void Add(std::int64_t k, OdometryFrame::Status status, double off_m, OpenPoses* open,
         double sweep_m_s = kSpeedMS, std::int64_t times_slower = 1) {
  MapperScan scan;
  scan.number = k;
  scan.stamp_ns = k * times_slower * kPeriodNs;
  scan.middle_ns = times_slower * kMiddleNs;
  OdometryFrame frame;
  frame.status = status;
  frame.stamp_ns = scan.stamp_ns + scan.middle_ns;
  frame.T_world_lidar = TrueAt(frame.stamp_ns);
  frame.T_world_lidar.t.x() += off_m;
  frame.sweep.twist(3) = sweep_m_s;
  open->Add(scan, frame);
}

double WorstM(const OpenPoses& open, std::size_t from) {
  const Trajectory poses = open.AtStamps();
  double worst_m = 0.0;
  for (std::size_t k = from; k < poses.size(); ++k)
    worst_m = std::max(worst_m, (poses[k].T_world_lidar.t - TrueAt(poses[k].stamp_ns).t).norm());
  return worst_m;
}

// A lost scan is where it was expected: the way from there to the first one that is found again is
// none that the sensor has gone, and does not say how it moved from stamp to middle.
TEST(OpenPosesTest, TheMotionWithinAFoundScanIsNotThatFromALostOne) {
  OpenPoses open;
  Add(0, OdometryFrame::Status::kTracked, 0.0, &open);
  Add(1, OdometryFrame::Status::kTracked, 0.0, &open);
  Add(2, OdometryFrame::Status::kLost, -1.0, &open);
  Add(3, OdometryFrame::Status::kTracked, 0.0, &open);
  Add(4, OdometryFrame::Status::kTracked, 0.0, &open);
  EXPECT_LT(WorstM(open, 3), 1e-9);
  EXPECT_EQ(open.size(), 5u);
}

TEST(OpenPosesTest, TheMotionWithinAScanIsThatThroughItsNeighbours) {
  OpenPoses open;
  Add(0, OdometryFrame::Status::kTracked, 0.0, &open);
  Add(1, OdometryFrame::Status::kTracked, 0.0, &open);
  // Its own sweep would have the stamp elsewhere.
  Add(2, OdometryFrame::Status::kTracked, 0.0, &open, 0.0);
  EXPECT_NEAR(WorstM(open, 2), kSpeedMS * SecondsBetween(0, kMiddleNs), 1e-9);
  Add(3, OdometryFrame::Status::kTracked, 0.0, &open);
  EXPECT_LT(WorstM(open, 2), 1e-9);
}

// Of a sensor of 1 Hz, too, of which the first scans are registered without any motion.
TEST(OpenPosesTest, LongSweepsHaveTheMotionThroughTheirNeighbours) {
  OpenPoses open;
  for (std::int64_t k = 0; k < 4; ++k)
    Add(k, OdometryFrame::Status::kTracked, 0.0, &open, k < 2 ? 0.0 : kSpeedMS, 10);
  EXPECT_LT(WorstM(open, 0), 1e-9);
}

// Bundle adjustment finds the sensor to be slower than the frontend thought, which changes where it
// was at the stamps before the middles of the sweeps, too: also of the oldest frame, whose
// neighbours are final.
TEST(OpenPosesTest, KeyframesThatMoveTakeTheMotionWithinTheirScansAlong) {
  constexpr double kSlower = 0.5;
  OpenPoses open;
  for (std::int64_t k = 0; k < 12; ++k) {
    Add(k, OdometryFrame::Status::kTracked, 0.0, &open);
    open.AddKeyframe(TrueAt(k * kPeriodNs + kMiddleNs));
    open.Set(static_cast<std::size_t>(k), open.newest_keyframe(), SweepMotion());
  }
  const auto slow_down = [&](std::int64_t from) {
    for (std::int64_t k = from; k < 12; ++k)
      open.Keyframe(k).t = kSlower * TrueAt(k * kPeriodNs + kMiddleNs).t;
    open.UpdateMotions();
  };
  slow_down(0);
  const auto expect_slow = [](const Trajectory& poses) {
    for (const StampedPose& pose : poses)
      EXPECT_NEAR(pose.T_world_lidar.t.x(), kSlower * TrueAt(pose.stamp_ns).t.x(), 1e-9);
  };
  expect_slow(open.TakeFinal(4, 0));
  // Those that stay are moved once more.
  slow_down(4);
  Trajectory rest = open.AtStamps();
  ASSERT_EQ(rest.size(), 8u);
  // There is no pose after the newest one.
  rest.pop_back();
  expect_slow(rest);
}

}  // namespace
}  // namespace lamina
