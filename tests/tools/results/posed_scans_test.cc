#include <gtest/gtest.h>

#include <random>

#include "tests/support/memory_scans.h"
#include "tools/results/posed_scans.h"

namespace lamina {
namespace {

std::vector<Scan> EmptyScans(const std::vector<StampNs>& stamps) {
  std::vector<Scan> scans(stamps.size());
  for (size_t i = 0; i < stamps.size(); ++i) scans[i].stamp_ns = stamps[i];
  return scans;
}

TEST(SweepDeskew, IsTheExponentialOfTheTwist) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 1000; ++i) {
    Vector6d twist;
    for (int k = 0; k < 6; ++k) twist(k) = (k < 3 ? 1.0 : 20.0) * normal(random);
    if (i % 4 == 0) twist.head<3>() *= 1e-6;
    if (i % 4 == 1) twist.head<3>().setZero();
    TimedPoint p{};
    p.x = static_cast<float>(50.0 * normal(random));
    p.y = static_cast<float>(50.0 * normal(random));
    p.z = static_cast<float>(5.0 * normal(random));
    p.time_s = static_cast<float>(0.3 * normal(random));
    const Eigen::Vector3d expected =
        TwistExp(static_cast<double>(p.time_s) * twist) * Eigen::Vector3d(p.x, p.y, p.z);
    EXPECT_LT((SweepDeskew(twist)(p) - expected).norm(), 1e-8);
    const SweepMotion unsteady(twist, Vector6d::Constant(3.0));
    EXPECT_LT(
        (SweepDeskew(unsteady)(p) - unsteady.PoseAt(p.time_s) * Eigen::Vector3d(p.x, p.y, p.z))
            .norm(),
        1e-8);
  }
}

TEST(PoseScans, FindsScansByStampAndLeavesOutTheRest) {
  const MemoryScans scans(EmptyScans({1000000000, 1100000000, 1200000000, 1300000000}));
  Trajectory trajectory;
  for (const StampNs stamp : {1300000000, 1000400000, 1201000000}) {
    trajectory.push_back({stamp, SE3(Eigen::Quaterniond::Identity(),
                                     Eigen::Vector3d(static_cast<double>(stamp), 0, 0))});
  }
  const std::vector<PosedScan> posed = PoseScans(scans, trajectory, 5e-4);
  ASSERT_EQ(posed.size(), 2U);
  EXPECT_EQ(posed[0].scan, 0U);
  EXPECT_EQ(posed[0].T_world_lidar.t.x(), 1000400000.0);
  EXPECT_EQ(posed[1].scan, 3U);
  EXPECT_EQ(PoseScans(scans, trajectory, 1e-2).size(), 3U);
  EXPECT_TRUE(PoseScans(scans, {}, 1e-2).empty());
}

TEST(PoseScans, OfScansWithOneStampTakesTheFirst) {
  const MemoryScans scans(EmptyScans({100, 200, 200, 150}));
  const Trajectory trajectory{{100, SE3()}, {150, SE3()}, {200, SE3()}};
  const std::vector<PosedScan> posed = PoseScans(scans, trajectory, 0.0);
  ASSERT_EQ(posed.size(), 3U);
  EXPECT_EQ(posed[0].scan, 0U);
  EXPECT_EQ(posed[1].scan, 3U);
  EXPECT_EQ(posed[2].scan, 1U);
}

TEST(PoseScans, MotionIsThatThroughThePosesAround) {
  const MemoryScans scans(EmptyScans({0, 100000000, 300000000}));
  Vector6d before;
  before << 0.1, 0.2, -0.3, 5.0, 1.0, 0.0;
  Vector6d after;
  after << -0.1, 0.0, 0.4, 7.0, 0.0, 1.0;
  const SE3 first = TwistExp(after);
  const SE3 second = first * TwistExp(0.1 * before);
  const Trajectory trajectory{
      {0, first}, {100000000, second}, {300000000, second * TwistExp(0.2 * after)}};
  const std::vector<PosedScan> posed = PoseScans(scans, trajectory, 1e-3);
  ASSERT_EQ(posed.size(), 3U);
  const Vector6d change = (after - before) / 0.15;
  EXPECT_LT((posed[0].sweep.twist - (before - 0.05 * change)).norm(), 1e-9);
  EXPECT_LT((posed[1].sweep.twist - (2.0 * before + after) / 3.0).norm(), 1e-9);
  EXPECT_LT((posed[1].sweep.acceleration - change).norm(), 1e-9);
  EXPECT_LT((posed[2].sweep.twist - after).norm(), 1e-9);
  EXPECT_EQ(PoseScans(scans, {trajectory[1]}, 1e-3)[0].sweep.twist, Vector6d(Vector6d::Zero()));
}

TEST(SweepPeriodOfScan, KnowsThePeriodFromTheFirstScanOn) {
  std::vector<StampNs> stamps;
  for (StampNs i = 0; i < 30; ++i) stamps.push_back(i * 50000000 + (i >= 20 ? 700000000 : 0));
  const MemoryScans scans(EmptyScans(stamps));
  for (const size_t i : {0U, 1U, 15U, 20U, 29U}) {
    EXPECT_NEAR(SweepPeriodOfScan(scans, i, 0.1), 0.05, 1e-12) << "scan " << i;
  }
  EXPECT_EQ(SweepPeriodOfScan(MemoryScans(EmptyScans({7})), 0, 0.1), 0.1);
}

}  // namespace
}  // namespace lamina
