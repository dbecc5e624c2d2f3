#include "frontend/start/start_track.h"
#include "core/base/angle.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "tests/support/scenes/bay_street.h"

namespace lamina {
namespace {

// The sensor drives at 3 m/s, in a row of vans on either side that do so on the whole.
constexpr double kSpeedM = 3.0, kPeriodS = 0.1;

struct Van {
  double x, y, rate, phase;

  double AlongAt(double t) const { return x + 1.1 * std::sin(rate * t + phase); }
};

// Range to an upright box about `centre`; infinite where the ray misses it.
double CastBox(const Eigen::Vector3d& centre, const Eigen::Vector3d& half,
               const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) {
  double near = 0.0, far = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    const double a = (centre(axis) - half(axis) - origin(axis)) / direction(axis);
    const double b = (centre(axis) + half(axis) - origin(axis)) / direction(axis);
    near = std::max(near, std::min(a, b));
    far = std::min(far, std::max(a, b));
  }
  return near <= far && near > 0.0 ? near : std::numeric_limits<double>::infinity();
}

class StartTrackTest : public testing::Test {
 protected:
  static SE3 Truth(int scan) { return BayStreet::PoseAt(kSpeedM * kPeriodS * scan); }
  static SE3 FromStart(int scan) { return Truth(0).Inverse() * Truth(scan); }
  static StampNs Stamp(int scan) { return scan * StampNs{100'000'000}; }

  std::vector<TimedCluster> Scan(int scan) { return ScanFrom(Truth(scan), scan); }
  std::vector<TimedCluster> ScanFrom(const SE3& T, int scan) {
    std::vector<TimedPoint> points;
    while (points.size() < 40000) {
      const double azimuth = draws_.Uniform(-M_PI, M_PI);
      AddRay(T, scan, azimuth, Radians(draws_.Uniform(-25.0, 15.0)), &points);
    }
    return BuildScanClusters(points, map_.LeafSize());
  }
  // The same of 16 rings.
  std::vector<TimedCluster> Rings(const SE3& T, int scan) {
    std::vector<TimedPoint> points;
    for (int ring = 0; ring < 16; ++ring) {
      for (int step = 0; step < 900; ++step)
        AddRay(T, scan, Radians(0.4 * step - 180.0), Radians(2.0 * ring - 15.0), &points);
    }
    return BuildScanClusters(points, map_.LeafSize());
  }
  void AddRay(const SE3& T, int scan, double azimuth, double elevation,
              std::vector<TimedPoint>* points) {
    const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                    std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
    double range = street_.Cast(T.t, direction);
    for (const Van& van : vans_) {
      const Eigen::Vector3d centre(T.t.x() + van.AlongAt(kPeriodS * scan), van.y, 1.1);
      range = std::min(range, CastBox(centre, {2.4, 0.95, 0.9}, T.t, direction));
    }
    if (range > 100.0) return;
    const Eigen::Vector3f p = ((range + draws_.Normal(0.01)) * direction).cast<float>();
    points->push_back({p.x(), p.y(), p.z(), 0.0F});
  }

  // What odometry made of a scan: a match so far along the way from the truth.
  static OdometryFrame Matched(int scan, double off_m) {
    OdometryFrame frame;
    frame.stamp_ns = Stamp(scan);
    frame.T_world_lidar = FromStart(scan);
    if (scan == 0) return frame;
    frame.status = OdometryFrame::Status::kTracked;
    frame.T_world_lidar.t.x() += off_m;
    frame.match.status = MatchResult::Status::kConverged;
    frame.match.T_world_lidar = frame.T_world_lidar;
    return frame;
  }
  // By how much the first van goes on less than the street.
  double WithVan(int scan) const {
    return vans_[0].AlongAt(0.0) - vans_[0].AlongAt(kPeriodS * scan) - kSpeedM * kPeriodS * scan;
  }

  const BayStreet street_{3};
  Draws draws_{4};
  const OdometryOptions options_;
  const VoxelMapOptions map_;
  std::vector<Van> vans_ = {{0.0, -4.0, 1.2, 0.6}, {0.0, 4.0, 1.2, 0.7},  {-7.0, -4.0, 0.9, 2.0},
                            {-7.0, 4.0, 1.5, 3.0}, {7.0, -4.0, 1.0, 4.0}, {7.0, 4.0, 1.4, 5.0},
                            {11.0, 0.0, 1.1, 5.5}};
};

TEST_F(StartTrackTest, TheStaticWorldOverrulesWhatMovesAlong) {
  StartTrack start(options_, map_);
  int scan = 0;
  for (; start.open() && scan < 10; ++scan)
    start.Add(Matched(scan, scan == 0 ? 0.0 : WithVan(scan)), false, Scan(scan));
  ASSERT_TRUE(start.overruled());
  ASSERT_EQ(start.scans().size(), static_cast<std::size_t>(scan));
  for (int k = 0; k < scan; ++k) {
    const StartTrack::Scan& taken = start.scans()[static_cast<std::size_t>(k)];
    EXPECT_LT((taken.T_world_lidar.t - FromStart(k).t).norm(), 0.03) << k;
    EXPECT_EQ(taken.stamp_ns, Stamp(k));
    EXPECT_NEAR(taken.twist(3), kSpeedM, 0.3) << k;
  }
  EXPECT_GT(start.match().inlier_share, 0.3);
  // Bundle adjustment keeps the way that all scans together have told.
  EXPECT_NEAR(std::abs(start.match().degenerate_directions(3, 0)), 1.0, 0.01);
  EXPECT_GT(start.match().degenerate_information(0), 1e5);
  start.Clear();
  EXPECT_FALSE(start.overruled());
  EXPECT_TRUE(start.scans().empty());
}

TEST_F(StartTrackTest, TheStaticWorldStays) {
  StartTrack start(options_, map_);
  for (int scan = 0; start.open() && scan < 15; ++scan) {
    start.Add(Matched(scan, 0.0), false, Scan(scan));
    EXPECT_TRUE(scan < 10 || !start.contested()) << scan;
  }
  EXPECT_FALSE(start.given_up());
  EXPECT_FALSE(start.open());
  EXPECT_FALSE(start.overruled());
}

TEST_F(StartTrackTest, AStreetWhereNothingMovesIsDecidedAtOnce) {
  vans_.clear();
  StartTrack start(options_, map_);
  for (int scan = 0; scan < 2; ++scan) start.Add(Matched(scan, 0.0), false, Scan(scan));
  EXPECT_FALSE(start.contested());
  EXPECT_FALSE(start.overruled());
}

TEST_F(StartTrackTest, WhatIsContestedIsUncertain) {
  StartTrack start(options_, map_);
  EXPECT_FALSE(start.contested());
  for (int scan = 0; scan < 2; ++scan) start.Add(Matched(scan, 0.0), false, Scan(scan));
  ASSERT_TRUE(start.contested());
  const Matrix6d spread = start.Spread(FromStart(1));
  EXPECT_GT(std::sqrt(spread(3, 3)), 0.1);
  EXPECT_LT(std::sqrt(spread(4, 4)), 0.1);
}

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
    again.FollowGivenUp();
    EXPECT_FALSE(gives_up(again)) << rate;
  }
  EXPECT_GE(given_up, 1);
}

TEST_F(StartFromRestTest, OfFewRingsASensorThatStandsIsBelieved) {
  StartTrack start(options_, map_);
  for (int scan = 0; start.open() && scan < 15; ++scan) {
    start.Add(MatchedAt(scan, 0.0, 0.0), false, Rings(BayStreet::PoseAt(0.0), scan));
    EXPECT_FALSE(start.given_up()) << scan;
  }
  EXPECT_FALSE(start.open());
  EXPECT_FALSE(start.overruled());
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
    const StartTrack::Scan& taken = start.scans()[static_cast<std::size_t>(k)];
    EXPECT_LT((taken.T_world_lidar.t - off - FromStartFast(k).t).norm(), 0.15) << k;
    EXPECT_NEAR(taken.twist(3), kFastM, 0.5) << k;
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

TEST_F(StartTrackTest, ScansWithoutMeasuredTimesAreLeftAlone) {
  for (const bool made_up : {true, false}) {
    StartTrack start(options_, map_);
    start.Add(Matched(0, 0.0), made_up, Scan(0));
    EXPECT_TRUE(start.open());
    start.Add(Matched(made_up ? 1 : 3, 0.0), made_up, Scan(1));
    EXPECT_FALSE(start.open());
    EXPECT_FALSE(start.overruled());
  }
}

TEST_F(StartTrackTest, GoesOnFromItsArchive) {
  std::vector<std::vector<TimedCluster>> scans;
  for (int scan = 0; scan < 8; ++scan) scans.push_back(Scan(scan));
  StartTrack start(options_, map_);
  for (int scan = 0; scan < 2; ++scan)
    start.Add(Matched(scan, scan == 0 ? 0.0 : WithVan(scan)), false,
              scans[static_cast<std::size_t>(scan)]);
  ASSERT_TRUE(start.contested());
  StateArchive out;
  start.Archive(out);
  StartTrack again(options_, map_);
  StateArchive in{std::string_view(out.written())};
  again.Archive(in);
  EXPECT_EQ(in.unread(), 0U);
  for (int scan = 2; start.open() && scan < 8; ++scan) {
    for (StartTrack* track : {&start, &again})
      track->Add(Matched(scan, WithVan(scan)), false, scans[static_cast<std::size_t>(scan)]);
  }
  EXPECT_FALSE(again.open());
  ASSERT_EQ(again.overruled(), start.overruled());
  ASSERT_EQ(again.scans().size(), start.scans().size());
  for (std::size_t k = 0; k < start.scans().size(); ++k)
    EXPECT_EQ(again.scans()[k].T_world_lidar.t, start.scans()[k].T_world_lidar.t);
}

}  // namespace
}  // namespace lamina
