// Drives along a street in which little faces the way: what is called tracked must be right.
#include <gtest/gtest.h>

#include <functional>

#include "backend/bundle/solver/adjuster.h"
#include "backend/pieces/mapper.h"
#include "tests/support/scenes/bay_street.h"

namespace lamina {
namespace {

using FrameStatus = OdometryFrame::Status;

enum class ScanKind { kStreet, kSpray, kMissing };

struct StreetDrive {
  int points = 20000;
  int scans = 60;
  std::function<double(double)> way_m;  // by time
  std::function<ScanKind(int)> kind = [](int) { return ScanKind::kStreet; };
  bool start_known = false;  // whether the mapper is told the velocity of the first scan
  bool repeated = false;     // whether all scans have the same rays
  SE3 T_world_start;
  MapperOptions options;
};

struct DriveOutcome {
  int lost = 0, degenerate = 0;
  int left = 0;                        // keyframes that have left the window
  double worst_m = 0.0, last_m = 0.0;  // errors of frames called tracked and not degenerate
};

// Maps a drive with bundle adjustment, as the pipeline does.
DriveOutcome MapStreet(const StreetDrive& drive, unsigned seed) {
  constexpr double kPeriodS = 0.1;
  const BayStreet street(seed);
  Draws draws(seed + 100);
  MapperOptions options = drive.options;
  if (drive.start_known) {
    const SE3 step =
        BayStreet::PoseAt(drive.way_m(0.0)).Inverse() * BayStreet::PoseAt(drive.way_m(kPeriodS));
    options.start_velocity = TwistLog(step) / kPeriodS;
  }
  VoxelMap map(options.map);
  Mapper mapper(options, &map, 0, drive.T_world_start);
  BundleProblem problem;
  int frames = 0, due = -1;
  DriveOutcome outcome;
  mapper.SetOnFinalKeyframe([&](std::int64_t, const FinalKeyframe&) { ++outcome.left; });
  for (int i = 0; i < drive.scans; ++i) {
    if (drive.kind(i) == ScanKind::kMissing) continue;
    const SE3 T = BayStreet::PoseAt(drive.way_m(kPeriodS * i));
    const auto points = drive.kind(i) == ScanKind::kSpray ? BayStreet::Spray(drive.points, &draws)
                        : drive.repeated ? street.RingScan(T, 32, drive.points / 32, &draws)
                                         : street.Scan(T, drive.points, &draws);
    if (due == frames) {
      mapper.ApplySolve(AdjustBundle(problem, options.backend.solver));
      due = -1;
    }
    std::vector<TimedCluster> clusters = BuildScanClusters(points, options.map.LeafSize());
    const OdometryFrame frame =
        mapper.Process({i, i * StampNs{100000000}, false, &clusters}, /*may_restart=*/false)
            .odometry;
    ++frames;
    if (due < 0 && mapper.SolveDue()) {
      problem = mapper.PrepareSolve();
      due = frames + options.backend.hand_over_lag_frames;
    }
    const SE3 truth = drive.T_world_start * BayStreet::PoseAt(0.0).Inverse() * T;
    const bool lost = frame.status == FrameStatus::kLost;
    outcome.lost += lost ? 1 : 0;
    outcome.degenerate += !lost && frame.match.degenerate > 0 ? 1 : 0;
    if (lost || frame.match.degenerate > 0) continue;
    outcome.last_m = (frame.T_world_lidar.t - truth.t).norm();
    outcome.worst_m = std::max(outcome.worst_m, outcome.last_m);
  }
  return outcome;
}

// From rest with 3 m/s^2 to 15 m/s.
double Accelerating(double t) {
  constexpr double kTopS = 5.0;
  return t < kTopS ? 1.5 * t * t : 37.5 + 15.0 * (t - kTopS);
}

TEST(MapperStreet, ACarThatAcceleratesIsFollowedAtAnyDensity) {
  for (const int points : {8000, 40000}) {
    StreetDrive drive;
    drive.points = points;
    drive.way_m = Accelerating;
    const DriveOutcome outcome = MapStreet(drive, 3);
    EXPECT_EQ(outcome.lost, 0) << points;
    EXPECT_LT(outcome.worst_m, 0.1) << points;
    // With few points the motion itself is unknown for the first scans.
    EXPECT_LE(outcome.degenerate, points < 10000 ? 15 : 3) << points;
  }
}

// However many keyframes a rest would give, none leaves the window: all can be taken back where the
// sensor sets off, and it goes on where it was.
TEST(MapperStreet, AfterALongRestItSetsOffFromWhereItRested) {
  constexpr double kRestS = 4.0;
  StreetDrive drive;
  drive.scans = 55;
  drive.points = 60000;
  drive.repeated = true;
  drive.T_world_start.t = {100.0, -50.0, 3.0};
  drive.options.backend.keyframe_after_frames = 1;
  drive.way_m = [](double t) { return Accelerating(std::max(0.0, t - kRestS)); };
  const DriveOutcome outcome = MapStreet(drive, 3);
  EXPECT_EQ(outcome.lost, 0);
  EXPECT_LT(outcome.worst_m, 0.1);
  EXPECT_LE(outcome.degenerate, 13);  // as many as a start has scans
  EXPECT_EQ(outcome.left, 0);
}

// At speed from the first scan on.
StreetDrive StartAtSpeed(int scans) {
  StreetDrive drive;
  drive.points = 8000;
  drive.scans = scans;
  drive.way_m = [](double t) { return 15.0 * t; };
  return drive;
}

TEST(MapperStreet, AStartAtSpeedIsFollowed) {
  const StreetDrive drive = StartAtSpeed(40);
  const DriveOutcome outcome = MapStreet(drive, 4);
  EXPECT_EQ(outcome.lost, 0);
  EXPECT_LT(outcome.worst_m, 0.1);
}

TEST(MapperStreet, AStartAtAKnownVelocityIsTrackedFromTheSecondScan) {
  StreetDrive drive = StartAtSpeed(20);
  const DriveOutcome unknown = MapStreet(drive, 4);
  EXPECT_GT(unknown.lost + unknown.degenerate, 0);
  drive.start_known = true;
  const DriveOutcome known = MapStreet(drive, 4);
  EXPECT_EQ(known.lost + known.degenerate, 0);
  EXPECT_LT(known.worst_m, 0.1);
}

TEST(MapperStreet, HardBrakingIsFollowed) {
  StreetDrive drive;
  drive.scans = 50;
  drive.way_m = [](double t) {
    const double braking = std::clamp(t - 2.0, 0.0, 15.0 / 8.0);
    return 15.0 * std::min(t, 2.0) + 15.0 * braking - 4.0 * braking * braking;
  };
  const DriveOutcome outcome = MapStreet(drive, 5);
  EXPECT_EQ(outcome.lost, 0);
  EXPECT_LT(outcome.worst_m, 0.1);
}

// At full speed, from scan 25 on, so many of another kind.
DriveOutcome MapInterrupted(ScanKind by, int count, int scans, unsigned seed) {
  StreetDrive drive;
  drive.scans = scans;
  drive.way_m = [](double t) { return 15.0 * t; };
  drive.kind = [by, count](int i) { return i >= 25 && i < 25 + count ? by : ScanKind::kStreet; };
  return MapStreet(drive, seed);
}

TEST(MapperStreet, AfterSprayTheWayIsFoundAgain) {
  for (const int count : {11, 15}) {
    const DriveOutcome outcome = MapInterrupted(ScanKind::kSpray, count, 50, 6);
    EXPECT_GE(outcome.lost, count);
    EXPECT_LE(outcome.lost, count + 1);
    EXPECT_LT(outcome.worst_m, 0.1);
  }
}

TEST(MapperStreet, AfterAGapOfTheRecorderTheWayIsFoundAgain) {
  for (const int count : {10, 20}) {
    const DriveOutcome outcome = MapInterrupted(ScanKind::kMissing, count, 60, 7);
    EXPECT_LE(outcome.lost, 1);
    EXPECT_LT(outcome.worst_m, 0.1);
  }
}

}  // namespace
}  // namespace lamina
