#include "frontend/start/start_track.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "tests/frontend/start/start_track_fixture.h"

namespace lamina {
namespace {

TEST_F(StartTrackTest, TheStaticWorldOverrulesWhatMovesAlong) {
  StartTrack start(options_, map_);
  int scan = 0;
  for (; start.open() && scan < 10; ++scan)
    start.Add(Matched(scan, scan == 0 ? 0.0 : WithVan(scan)), false, Scan(scan));
  ASSERT_TRUE(start.overruled());
  ASSERT_EQ(start.scans().size(), static_cast<std::size_t>(scan));
  for (int k = 0; k < scan; ++k) {
    const StartScan& taken = start.scans()[static_cast<std::size_t>(k)];
    EXPECT_LT((taken.T_world_lidar.t - FromStart(k).t).norm(), 0.03) << k;
    EXPECT_EQ(taken.stamp_ns, Stamp(k));
    EXPECT_NEAR(taken.sweep.twist(3), kSpeedM, 0.3) << k;
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

// Its way refutes all others. Where it does not, all scans are waited for.
TEST_F(StartTrackTest, AStreetWhereNothingMovesIsToldByEightScans) {
  vans_.clear();
  StartTrack start(options_, map_);
  int scan = 0;
  for (; start.open() && scan < 15; ++scan) start.Add(Matched(scan, 0.0), false, Scan(scan));
  EXPECT_EQ(scan, 8);
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
