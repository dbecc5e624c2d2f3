#include "frontend/start/rest_at_start.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/scenes/bay_street.h"

namespace lamina {
namespace {

class RestAtStartTest : public testing::Test {
 protected:
  // A scan from so far along the street, where odometry has the sensor `seems_m` along it. Rays
  // that are `turned` lie between those that are not.
  bool SetsOff(double along_m, double seems_m, bool turned = false) {
    SE3 T = BayStreet::PoseAt(0.0);
    T.t.x() += along_m;
    const auto points = street_.RingScan(T, 16, kSteps, &draws_, turned ? 0.5 : 0.0);
    const std::vector<TimedCluster> clusters = BuildScanClusters(points, kLeafM);
    OdometryFrame frame;
    frame.status = scans_ == 0 ? OdometryFrame::Status::kFirst : status_;
    frame.stamp_ns = 100000000 * scans_++;
    frame.T_world_lidar.t.x() = seems_m;
    beams_.Add(clusters, frame.T_world_lidar);
    return rest_.SetsOff(frame, false, clusters, beams_.newest());
  }
  void Rest(int scans) {
    for (int i = 0; i < scans; ++i) ASSERT_FALSE(SetsOff(0.0, 0.002 * (i % 3))) << i;
  }

  static constexpr int kSteps = 90;
  static constexpr double kNoiseM = 0.01, kLeafM = 0.4;
  BayStreet street_{7};
  Draws draws_{11};
  RestingBeams beams_{kNoiseM};
  RestAtStart rest_;
  OdometryFrame::Status status_ = OdometryFrame::Status::kTracked;
  int scans_ = 0;
};

TEST_F(RestAtStartTest, RaysTellWhatThePosesDoNot) {
  Rest(12);
  // 3 m/s^2, of which odometry has nothing.
  int moving = 0;
  bool sets_off = false;
  for (double s = 0.1; !sets_off && s < 0.5; s += 0.1, ++moving) sets_off = SetsOff(1.5 * s * s, 0);
  EXPECT_TRUE(sets_off);
  EXPECT_LE(moving, 3);
  ASSERT_EQ(rest_.kept().size(), 2U);
  for (const RestAtStart::Kept& kept : rest_.kept()) EXPECT_FALSE(kept.clusters.empty());
  EXPECT_EQ(rest_.kept().back().stamp_ns - rest_.kept().front().stamp_ns, 100000000);
  // Once.
  EXPECT_FALSE(SetsOff(1.0, 1.0));
}

TEST_F(RestAtStartTest, SoDoPosesAlone) {
  Rest(5);
  EXPECT_TRUE(SetsOff(0.0, 0.03));
}

TEST_F(RestAtStartTest, ALongRestIsOne) {
  Rest(300);
  EXPECT_TRUE(SetsOff(0.1, 0.1));
}

TEST_F(RestAtStartTest, WhatMovesFromTheFirstScanOnHasNotRested) {
  EXPECT_FALSE(SetsOff(0.0, 0.0));
  for (int i = 1; i < 20; ++i) EXPECT_FALSE(SetsOff(0.5 * i, 0.5 * i));
  EXPECT_TRUE(rest_.kept().empty());
}

// From one place such a sensor sees something else in every scan, and the map of them is worth more
// than that of one.
TEST_F(RestAtStartTest, RaysThatAreOthersInEachScanAreNotAskedAbout) {
  for (int i = 0; i < 12; ++i) ASSERT_FALSE(SetsOff(0.0, 0.0, i % 2 == 0)) << i;
  EXPECT_FALSE(SetsOff(0.03, 0.03, true));
  EXPECT_FALSE(SetsOff(0.1, 0.1, false));
}

TEST_F(RestAtStartTest, AfterAFalseAlarmMoreIsAsked) {
  Rest(8);
  ASSERT_TRUE(SetsOff(0.2, 0.0));
  rest_.GoOn(/*rests=*/true);
  Rest(8);
  EXPECT_FALSE(SetsOff(0.2, 0.0));
  Rest(8);
  EXPECT_TRUE(SetsOff(1.5, 0.0));
  // It has set off.
  rest_.GoOn(/*rests=*/false);
  EXPECT_TRUE(rest_.over());
  EXPECT_TRUE(rest_.kept().empty());
}

// A start closes at a gap: the map of the rest would be taken back for nothing.
TEST_F(RestAtStartTest, AcrossAGapNothingIsAsked) {
  Rest(8);
  scans_ += 6;
  EXPECT_FALSE(SetsOff(0.2, 0.2));
  for (int i = 0; i < 6; ++i) EXPECT_FALSE(SetsOff(0.2, 0.2));
  EXPECT_TRUE(SetsOff(0.3, 0.3));
}

// A piece may begin while the sensor comes to a stand.
TEST_F(RestAtStartTest, ARestAfterAFewMetresIsOneAsWell) {
  for (const double way_m : {0.0, 1.0, 1.7, 2.0, 2.1, 2.1, 2.1, 2.1, 2.1, 2.1, 2.1})
    ASSERT_FALSE(SetsOff(way_m, way_m));
  EXPECT_TRUE(rest_.rests());
  // Of a start that ends meanwhile the metres count.
  rest_.GoOn(/*rests=*/false);
  for (int i = 0; i < 6; ++i) ASSERT_FALSE(SetsOff(2.1, 2.1));
  EXPECT_TRUE(SetsOff(2.2, 2.2));
}

TEST_F(RestAtStartTest, AfterMoreMetresNoRestIsOne) {
  for (const double way_m : {0.0, 2.0, 4.0, 6.0}) ASSERT_FALSE(SetsOff(way_m, way_m));
  EXPECT_TRUE(rest_.over());
  rest_.GoOn(/*rests=*/false);
  EXPECT_TRUE(rest_.over());
}

TEST_F(RestAtStartTest, PosesThatMoveAsAWholeAreAtRest) {
  Rest(8);
  rest_.Move(SE3(Eigen::Quaterniond::Identity(), {0.2, 0.0, 0.0}));
  EXPECT_FALSE(SetsOff(0.0, 0.2));
  EXPECT_TRUE(SetsOff(0.0, 0.0));
}

TEST_F(RestAtStartTest, OfASensorThatIsLostNothingIsKnown) {
  Rest(6);
  status_ = OdometryFrame::Status::kLost;
  EXPECT_FALSE(SetsOff(0.2, 0.2));
  status_ = OdometryFrame::Status::kTracked;
  EXPECT_FALSE(SetsOff(0.5, 0.5));
}

}  // namespace
}  // namespace lamina
