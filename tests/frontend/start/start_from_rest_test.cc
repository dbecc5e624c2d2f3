// Starts from rest, and starts of few points: all scans together tell the way.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/frontend/start/start_track_fixture.h"

namespace lamina {
namespace {

// The sensor starts from rest with 3 m/s^2, and so does what stands beside it.
class StartFromRestTest : public StartTrackTest {
 protected:
  static double WayM(int scan) { return 1.5 * std::pow(kPeriodS * scan, 2); }
  static SE3 FromRest(int scan) {
    return BayStreet::PoseAt(0.0).Inverse() * BayStreet::PoseAt(WayM(scan));
  }
  std::vector<TimedCluster> ScanFromRest(int scan) {
    return ScanFrom(BayStreet::PoseAt(WayM(scan)), scan);
  }
  // Odometry has the sensor there along the way.
  static OdometryFrame MatchedAt(int scan, double along_m, double open_m) {
    OdometryFrame frame = Matched(scan, 0.0);
    frame.T_world_lidar = FromRest(scan);
    frame.T_world_lidar.t.x() = along_m;
    frame.match.T_world_lidar = frame.T_world_lidar;
    frame.open_m = scan == 0 ? 0.0 : open_m;
    frame.match.weakest_direction = Vector6d::Unit(3);
    return frame;
  }
};

TEST_F(StartFromRestTest, AWayPartsLaterFromThatOfALorryThatStartsAlongside) {
  vans_ = {{-6.0, -4.0, 0.02, 0.0}, {0.0, -4.0, 0.02, 0.0}, {6.0, -4.0, 0.02, 0.0}};
  StartTrack start(options_, map_);
  int scan = 0;
  for (; start.open() && scan < 15; ++scan)
    start.Add(MatchedAt(scan, 0.0, 0.2), false, ScanFromRest(scan));
  ASSERT_TRUE(start.overruled());
  for (int k = 0; k < scan; ++k) {
    const SE3& T = start.scans()[static_cast<std::size_t>(k)].T_world_lidar;
    const SE3 from_first = start.scans().front().T_world_lidar.Inverse() * T;
    EXPECT_LT((from_first.t - FromRest(k).t).norm(), 0.06) << k;
  }
}

// All that is near sets off with the sensor, and odometry, which is sure of each match, stays.
TEST_F(StartFromRestTest, WhatSetsOffTogetherHoldsNobodyWhoIsAskedOnceMore) {
  for (Van& van : vans_) van.rate = 0.05;
  StartTrack start(options_, map_);
  int scan = 0;
  for (; start.open() && scan < 15; ++scan) {
    start.Add(MatchedAt(scan, 0.0, 0.0), false, ScanFromRest(scan));
    EXPECT_FALSE(start.given_up());
  }
  ASSERT_TRUE(start.overruled());
  for (int k = 0; k < scan; ++k) {
    const SE3& T = start.scans()[static_cast<std::size_t>(k)].T_world_lidar;
    const SE3 from_first = start.scans().front().T_world_lidar.Inverse() * T;
    EXPECT_LT((from_first.t - FromRest(k).t).norm(), 0.06) << k;
  }
}

// Sixteen rings lie on the same lines of all things as long as the sensor hardly moves, and a map
// of lines is sharp. Odometry has the sensor stand among vans that set off with it.
TEST_F(StartFromRestTest, AWayOnTheSameLinesOfAllThingsIsNotBelieved) {
  for (const double rate : {0.05, 0.3}) {
    for (Van& van : vans_) van.rate = rate;
    StartTrack start(options_, map_);
    int scan = 0;
    for (; start.open() && scan < 15; ++scan)
      start.Add(MatchedAt(scan, 0.0, 0.0), false, Rings(BayStreet::PoseAt(WayM(scan)), scan));
    EXPECT_TRUE(start.given_up() || start.overruled()) << rate;
  }
}

// By then what had set off would be faster; among walking people a sensor may stand for hours.
TEST_F(StartFromRestTest, StandingIsGivenUpOnlyOnce) {
  int given_up = 0;
  for (const double rate : {0.05, 0.3}) {
    for (Van& van : vans_) van.rate = rate;
    const auto gives_up = [&](StartTrack start) {
      for (int scan = 0; start.open() && scan < 15; ++scan)
        start.Add(MatchedAt(scan, 0.0, 0.0), false, Rings(BayStreet::PoseAt(WayM(scan)), scan));
      return start.given_up();
    };
    given_up += gives_up(StartTrack(options_, map_)) ? 1 : 0;
    StartTrack again(options_, map_);
    again.FollowPiece(/*given_up=*/true);
    EXPECT_FALSE(gives_up(again)) << rate;
  }
  EXPECT_GE(given_up, 1);
}

TEST_F(StartFromRestTest, OfFewRingsASensorThatStandsIsBelieved) {
  for (const int noise : {100, 200, 300}) {
    StartTrack start(options_, map_);
    for (int scan = 0; start.open() && scan < 15; ++scan) {
      start.Add(MatchedAt(scan, 0.0, 0.0), false, Rings(BayStreet::PoseAt(0.0), noise + scan));
      EXPECT_FALSE(start.given_up()) << scan;
    }
    EXPECT_FALSE(start.open());
    EXPECT_FALSE(start.overruled());
  }
}

TEST_F(StartFromRestTest, OdometryThatIsRightStays) {
  for (const bool standing : {true, false}) {
    StartTrack start(options_, map_);
    for (int scan = 0; start.open() && scan < 15; ++scan) {
      const int at = standing ? 0 : scan;
      start.Add(MatchedAt(scan, WayM(at), 0.0), false, ScanFromRest(at));
      EXPECT_FALSE(start.given_up()) << standing << " " << scan;
    }
    EXPECT_FALSE(start.open()) << standing;
    EXPECT_FALSE(start.overruled()) << standing;
  }
}

TEST_F(StartFromRestTest, WhatLeavesTheVansBehindIsNotHeldOpen) {
  constexpr double kFastM = 12.0;
  vans_.clear();
  StartTrack start(options_, map_);
  for (int scan = 0; scan < 2; ++scan)
    start.Add(MatchedAt(scan, kFastM * kPeriodS * scan, 0.0), false,
              ScanFrom(BayStreet::PoseAt(kFastM * kPeriodS * scan), scan));
  EXPECT_FALSE(start.open());
}

TEST_F(StartFromRestTest, AWayThatNoSensorTakesIsOverruled) {
  // Odometry jumps between the street and what moves along.
  constexpr double kJumpsM[] = {0.0, 0.31, 0.38, 0.07, -0.07, 0.26, -0.15, 0.5};
  vans_.resize(4);
  StartTrack start(options_, map_);
  int scan = 0;
  for (; start.open() && scan < 15; ++scan)
    start.Add(MatchedAt(scan, kJumpsM[scan % 8], 0.5), false, ScanFromRest(scan));
  ASSERT_TRUE(start.overruled());
  for (int k = 0; k < scan; ++k) {
    const SE3& T = start.scans()[static_cast<std::size_t>(k)].T_world_lidar;
    const SE3 from_first = start.scans().front().T_world_lidar.Inverse() * T;
    EXPECT_LT((from_first.t - FromRest(k).t).norm(), 0.06) << k;
  }
}

// Scans that have nothing in common, as from few points in a row of bays.
TEST_F(StartFromRestTest, AStartThatNoWayExplainsIsGivenUp) {
  constexpr double kJumpsM[] = {0.0, 0.5, 0.1, -0.4, 0.3, 0.9, 0.2, -0.3};
  StartTrack start(options_, map_);
  int scan = 0;
  for (; start.open() && scan < 20; ++scan) {
    EXPECT_FALSE(start.given_up());
    start.Add(MatchedAt(scan, kJumpsM[scan % 8], 0.5), false,
              BuildScanClusters(BayStreet(100 + static_cast<unsigned>(scan))
                                    .Scan(BayStreet::PoseAt(0.0), 1500, &draws_),
                                map_.LeafSize()));
    EXPECT_TRUE(scan < 3 || !start.open() || start.unsettled()) << scan;
  }
  EXPECT_FALSE(start.open());
  EXPECT_TRUE(start.given_up());
  EXPECT_FALSE(start.overruled());
  EXPECT_TRUE(start.scans().empty());
}

// Scans of so few points that what two of them have in common says nothing of the way.
class SparseStartTest : public StartTrackTest {
 protected:
  // By how far odometry is off in each of them.
  static constexpr double kOffM[] = {0.0, 0.2, -0.15, 0.1, 0.3, -0.2, -0.1, 0.25, 0.1, 0.0};

  std::vector<TimedCluster> Sparse(int scan) {
    const SE3 T = BayStreet::PoseAt(kFastM * kPeriodS * scan);
    return BuildScanClusters(street_.Scan(T, 3000, &draws_), map_.LeafSize());
  }
  static OdometryFrame Unsure(int scan, double off_m) {
    OdometryFrame frame = Matched(scan, 0.0);
    frame.T_world_lidar = FromStartFast(scan);
    frame.T_world_lidar.t.x() += off_m;
    frame.match.T_world_lidar = frame.T_world_lidar;
    frame.open_m = scan == 0 ? 0.0 : 0.3;
    frame.match.weakest_direction = Vector6d::Unit(3);
    return frame;
  }
  static SE3 FromStartFast(int scan) {
    return BayStreet::PoseAt(0.0).Inverse() * BayStreet::PoseAt(kFastM * kPeriodS * scan);
  }

  static constexpr double kFastM = 12.0;
};

TEST_F(SparseStartTest, ManyScansTellTheWayThatTwoDoNot) {
  StartTrack start(options_, map_);
  int scan = 0;
  for (; start.open() && scan < 10; ++scan) {
    start.Add(Unsure(scan, kOffM[scan]), false, Sparse(scan));
    if (scan == 1) {
      ASSERT_TRUE(start.contested());
    }
  }
  ASSERT_TRUE(start.overruled());
  ASSERT_EQ(start.scans().size(), static_cast<std::size_t>(scan));
  const Eigen::Vector3d off = start.scans().front().T_world_lidar.t;
  for (int k = 0; k < scan; ++k) {
    const StartScan& taken = start.scans()[static_cast<std::size_t>(k)];
    EXPECT_LT((taken.T_world_lidar.t - off - FromStartFast(k).t).norm(), 0.15) << k;
    EXPECT_NEAR(taken.sweep.twist(3), kFastM, 0.5) << k;
  }
  // Planes led odometry elsewhere: bundle adjustment is to keep out of the way.
  EXPECT_GT(start.match().degenerate_information(0), 0.0);
}

TEST_F(SparseStartTest, WhereOdometryIsRightNothingIsOpenAnyMore) {
  StartTrack start(options_, map_);
  int scan = 0;
  for (; start.open() && scan < 10; ++scan) start.Add(Unsure(scan, 0.0), false, Sparse(scan));
  ASSERT_TRUE(start.overruled());
  for (int k = 0; k < scan; ++k) {
    const SE3& T = start.scans()[static_cast<std::size_t>(k)].T_world_lidar;
    EXPECT_LT((T.t - FromStartFast(k).t).norm(), 0.1) << k;
  }
  EXPECT_LT(start.match().covariance(3, 3), 0.06 * 0.06);
  // Bundle adjustment knows the way better.
  EXPECT_TRUE(start.match().degenerate_information.isZero());
}

TEST_F(SparseStartTest, AnOpenTurnIsNoneOfASteadyWay) {
  StartTrack start(options_, map_);
  for (int scan = 0; scan < 3; ++scan) {
    OdometryFrame frame = Unsure(scan, 0.0);
    frame.match.weakest_direction = Vector6d::Unit(1);
    start.Add(frame, false, Sparse(scan));
  }
  EXPECT_FALSE(start.overruled());
}

}  // namespace
}  // namespace lamina
