#include "frontend/odometry/lost_track.h"

#include <gtest/gtest.h>

#include "core/base/angle.h"
#include "frontend/odometry/odometry.h"
#include "tests/support/scenes/bay_street.h"
#include "tests/support/scenes/shaken_sensor.h"

namespace lamina {
namespace {

class LostTrackTest : public testing::Test {
 protected:
  std::vector<TimedCluster> Scan(double along_m, int points = 10000) {
    return BuildScanClusters(street_.Scan(BayStreet::PoseAt(along_m), points, &draws_),
                             map_.LeafSize());
  }
  std::vector<TimedCluster> Spray(int points = 10000) {
    return BuildScanClusters(BayStreet::Spray(points, &draws_), map_.LeafSize());
  }
  VoxelMap MapAround(double along_m) {
    VoxelMap map(map_);
    for (int frame = 0; frame < 20; ++frame) {
      const SE3 pose = BayStreet::PoseAt(along_m + frame - 10.0);
      for (const TimedCluster& c :
           BuildScanClusters(street_.Scan(pose, 10000, &draws_), map_.LeafSize())) {
        const PointCluster moved = c.points.Moved(pose);
        map.AddWindow(map.LeafAt(moved.mean), moved, frame);
      }
    }
    map.Refresh();
    return map;
  }
  static StampNs Stamp(int i) { return i * 100'000'000LL; }

  const BayStreet street_{1};
  Draws draws_{2};
  const VoxelMapOptions map_;
  const OdometryOptions options_;
  const Vector6d still_ = Vector6d::Zero();
};

TEST_F(LostTrackTest, FollowsScansOfOnePlace) {
  LostTrack track(options_, map_);
  Vector6d twist = Vector6d::Zero();
  twist(3) = 9.0;  // as the sensor was last seen to move; in truth 10
  for (int i = 0; i < 12; ++i) track.Add(Stamp(i), Scan(1.0 * i), twist);
  EXPECT_EQ(track.scans(), 12);
  EXPECT_EQ(track.first_stamp_ns(), Stamp(0));
  const SE3 truth = BayStreet::PoseAt(0.0).Inverse() * BayStreet::PoseAt(11.0);
  EXPECT_LT((track.T_first_newest().t - truth.t).norm(), 0.1);
  EXPECT_NEAR(track.Twist()(3), 10.0, 0.3);
  // Together they cover more than one does, in voxels of the map's size.
  EXPECT_GT(track.Together().size(), Scan(11.0).size() * 3 / 2);
}

// Without a clock a step may be any number of those before.
TEST_F(LostTrackTest, FollowsUnevenStepsWithoutAClock) {
  int followed = 0, trials = 0, as_if_clocked = 0;
  for (double from_m = 0.0; from_m <= 60.0; from_m += 10.0) {
    LostTrack track(options_, map_), clocked(options_, map_);
    track.SetStampsRecorded(false);
    double along_m = from_m;
    int i = 0;
    for (const double step_m : {0.0, 1.5, 1.5, 4.5, 3.0}) {
      along_m += step_m;
      const std::vector<TimedCluster> scan = Scan(along_m);
      track.Add(Stamp(i), scan, still_);
      clocked.Add(Stamp(i++), scan, still_);
    }
    const SE3 truth = BayStreet::PoseAt(from_m).Inverse() * BayStreet::PoseAt(along_m);
    const auto right = [&](const LostTrack& t) {
      return t.scans() == 5 && (t.T_first_newest().t - truth.t).norm() < 0.15;
    };
    ++trials;
    followed += right(track) ? 1 : 0;
    as_if_clocked += right(clocked) ? 1 : 0;
  }
  EXPECT_GE(followed, trials - 1);
  EXPECT_LE(as_if_clocked, trials / 2);
}

// They lie beyond the reach of matching, whatever the sensor was seen to do before.
TEST_F(LostTrackTest, FollowsScansFarApart) {
  OdometryOptions blind = options_;
  blind.search.enabled = false;
  int followed = 0, trials = 0, without = 0;
  for (const double way_m : {5.0, 8.0}) {
    for (double from_m = 0.0; from_m <= 60.0; from_m += 10.0) {
      LostTrack track(options_, map_), unsearched(blind, map_);
      for (int i = 0; i < 4; ++i) {
        const std::vector<TimedCluster> scan = Scan(from_m + way_m * i);
        track.Add(Stamp(4 * i), scan, still_);
        unsearched.Add(Stamp(4 * i), scan, still_);
      }
      const SE3 truth =
          BayStreet::PoseAt(from_m).Inverse() * BayStreet::PoseAt(from_m + 3.0 * way_m);
      const auto right = [&](const LostTrack& t) {
        return t.scans() == 4 && (t.T_first_newest().t - truth.t).norm() < 0.15;
      };
      ++trials;
      followed += right(track) ? 1 : 0;
      without += right(unsearched) ? 1 : 0;
      EXPECT_TRUE(track.scans() < 4 || right(track)) << way_m << " m from " << from_m;
    }
  }
  EXPECT_GE(followed, trials - 2);
  EXPECT_LE(without, trials / 3);
  LostTrack wet(options_, map_);
  for (int i = 0; i < 3; ++i) wet.Add(Stamp(4 * i), Spray(), still_);
  EXPECT_EQ(wet.scans(), 1);
}

// Of so few points a second scan meets 0.20 to 0.28 of the first, spray 0.02 of spray.
TEST_F(LostTrackTest, FollowsScansOfFewPoints) {
  constexpr int kPoints = 1500;
  Vector6d twist = Vector6d::Zero();
  twist(3) = 10.0;
  for (int trial = 0; trial < 8; ++trial) {
    const double from_m = 7.0 * trial;
    LostTrack track(options_, map_);
    for (int i = 0; i < 6; ++i) track.Add(Stamp(i), Scan(from_m + i, kPoints), twist);
    ASSERT_EQ(track.scans(), 6) << trial;
    const SE3 truth = BayStreet::PoseAt(from_m).Inverse() * BayStreet::PoseAt(from_m + 5.0);
    // Little of so few points faces along the street.
    EXPECT_LT((track.T_first_newest().t - truth.t).norm(), 1.0) << trial;
    LostTrack wet(options_, map_);
    for (int i = 0; i < 3; ++i) {
      wet.Add(Stamp(i), Spray(kPoints), still_);
      ASSERT_EQ(wet.scans(), 1) << trial;
    }
  }
}

// Scans of which little ever lies on planes have little in common as well, but more than spray has.
TEST_F(LostTrackTest, FollowsScansThatNeverHadMuchInCommon) {
  constexpr int kPoints = 900;
  constexpr double kUsual = 0.2;
  Vector6d twist = Vector6d::Zero();
  twist(3) = 10.0;
  int followed = 0, strictly = 0;
  for (int trial = 0; trial < 8; ++trial) {
    LostTrack usual(options_, map_), strict(options_, map_), wet(options_, map_);
    for (int i = 0; i < 4; ++i) {
      const std::vector<TimedCluster> scan = Scan(7.0 * trial + i, kPoints);
      usual.Add(Stamp(i), scan, twist, kUsual);
      strict.Add(Stamp(i), scan, twist);
      wet.Add(Stamp(i), Spray(kPoints), still_, kUsual);
      EXPECT_EQ(wet.scans(), 1) << trial;
    }
    followed += usual.scans() == 4 ? 1 : 0;
    strictly += strict.scans() == 4 ? 1 : 0;
  }
  EXPECT_GE(followed, 6);
  EXPECT_LE(strictly, 4);
}

// A trotting robot turns to and fro by degrees from scan to scan, and during each.
TEST_F(LostTrackTest, FollowsAShakenSensor) {
  const World room = World::Room();
  int followed = 0;
  for (const double phase : {0.0, 1.0, 2.0, 3.0, 4.0, 5.0}) {
    const ShakenSensor sensor(3.4 * kDegree, 1.9, phase);
    LostTrack track(options_, map_);
    for (int i = 0; i < 12; ++i) {
      const Points points = room.Sample(2000, 0.003, &draws_);
      track.Add(Stamp(i), sensor.Sweep(points, map_.LeafSize(), 1.0, 0.1 * i), still_);
      followed += track.scans() > 1 ? 1 : 0;
    }
  }
  EXPECT_GT(followed, 50);  // of 66
}

TEST_F(LostTrackTest, SprayAgreesWithNothing) {
  LostTrack track(options_, map_);
  track.Add(Stamp(0), Scan(0.0), still_);
  track.Add(Stamp(1), Spray(), still_);
  EXPECT_EQ(track.scans(), 1);
  EXPECT_EQ(track.first_stamp_ns(), Stamp(1));
  track.Add(Stamp(2), Spray(), still_);
  EXPECT_EQ(track.scans(), 1);
  track.Add(Stamp(3), Scan(3.0), still_);
  EXPECT_EQ(track.scans(), 1);
  track.Clear();
  EXPECT_EQ(track.scans(), 0);
}

// Braking while nothing is seen: scans that see little of each other slide on at the speed of
// before.
TEST_F(LostTrackTest, IsStraightenedByTheMapItLiesIn) {
  constexpr int kPoints = 1500;
  constexpr double kStepM = 0.5;
  Matrix6d unknown = Matrix6d::Identity();
  Vector6d twist = Vector6d::Zero();
  twist(3) = 15.0;
  int bent = 0;
  for (int trial = 0; trial < 8; ++trial) {
    const double from_m = 20.0 + 7.0 * trial;
    const VoxelMap street = MapAround(from_m);
    LostTrack track(options_, map_);
    for (int i = 0; i < 4; ++i) track.Add(Stamp(i), Scan(from_m + kStepM * i, kPoints), twist);
    ASSERT_EQ(track.scans(), 4) << trial;
    const SE3 newest = BayStreet::PoseAt(from_m + 3.0 * kStepM);
    const SE3 truth = BayStreet::PoseAt(from_m).Inverse() * newest;
    const auto off_m = [&] { return (track.T_first_newest().t - truth.t).norm(); };
    const double before_m = off_m();
    const bool was_bent = track.Straighten({newest, unknown}, street, 0.3);
    EXPECT_EQ(was_bent, before_m > 0.1) << trial << ": " << before_m << " m, then " << off_m();
    EXPECT_LT(off_m(), 0.1) << trial;
    bent += was_bent ? 1 : 0;
    if (was_bent) {
      EXPECT_NEAR(track.Twist()(3), 10.0 * kStepM, 0.6) << trial;
    }
    EXPECT_FALSE(track.Straighten({newest, unknown}, street, 0.3)) << trial;
  }
  EXPECT_GE(bent, 3);
}

// Scans that lie on too few planes of the map are not in it, and nothing is learnt of their way.
TEST_F(LostTrackTest, IsNotStraightenedByAMapThatItHardlyMeets) {
  Vector6d twist = Vector6d::Zero();
  twist(3) = 15.0;
  LostTrack track(options_, map_);
  for (int i = 0; i < 4; ++i) track.Add(Stamp(i), Scan(20.0 + 0.5 * i, 1500), twist);
  const SE3 before = track.T_first_newest();
  const PosePrediction newest{BayStreet::PoseAt(21.5), Matrix6d::Identity()};
  EXPECT_FALSE(track.Straighten(newest, MapAround(20.0), 0.99));
  EXPECT_FALSE(track.Straighten(newest, VoxelMap(map_), 0.3));
  EXPECT_EQ(track.T_first_newest().t, before.t);
}

TEST_F(LostTrackTest, CountsGuessesOfOnePlace) {
  LostTrack track(options_, map_);
  Vector6d twist = Vector6d::Zero();
  twist(3) = 10.0;
  const auto at = [](double along_m) {
    return SE3(Eigen::Quaterniond::Identity(), {along_m, 0.0, 0.0});
  };
  for (int i = 0; i < 3; ++i) {
    track.Add(Stamp(i), Scan(1.0 * i), twist);
    ASSERT_EQ(track.scans(), i + 1);
    // The place goes along with the sensor.
    EXPECT_EQ(track.Guessed(at(40.0 + i)), i);
    track.Guess(at(40.0 + i));
  }
  EXPECT_EQ(track.Guessed(at(45.0)), 0);
  track.Guess(at(45.0));
  EXPECT_EQ(track.Guessed(at(42.0)), 0);
}

TEST_F(LostTrackTest, GoesOnFromItsArchive) {
  LostTrack track(options_, map_);
  Vector6d twist = Vector6d::Zero();
  twist(3) = 10.0;
  for (int i = 0; i < 3; ++i) track.Add(Stamp(i), Scan(1.0 * i), twist);
  StateArchive written;
  track.Archive(written);
  LostTrack copy(options_, map_);
  StateArchive read(written.written());
  copy.Archive(read);
  EXPECT_EQ(read.unread(), 0U);
  const std::vector<TimedCluster> next = Scan(3.0);
  track.Add(Stamp(3), next, twist);
  copy.Add(Stamp(3), next, twist);
  EXPECT_EQ(copy.scans(), 4);
  EXPECT_EQ(copy.T_first_newest().t, track.T_first_newest().t);
}

}  // namespace
}  // namespace lamina
