// Scans among good ones that drivers and transports have damaged: wrong times, wrong stamps, noise.
#include <gmock/gmock.h>

#include <cstddef>
#include <limits>
#include <map>
#include <vector>

#include "backend/mapping/mapping.h"
#include "tests/support/memory_scans.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

constexpr int kWalkSweeps = 24, kDamaged = 12;
constexpr StampNs kSweepNs = 100'000'000;
constexpr double kSweepSpeed = 2.0, kSweepTurn = 0.3, kGoodM = 0.02;

// At a steady walk.
SE3 SweepPoseAt(double t_s) {
  return TwistExp(
             (Vector6d() << 0.0, 0.0, kSweepTurn * t_s, kSweepSpeed * t_s, 0.0, 0.0).finished()) *
         SE3();
}

// Sweeps of 0.1 s, whose points come at times from `from_s` on about the stamp.
std::vector<Scan> SweepsOf(unsigned seed, double from_s = -0.05) {
  constexpr int kPoints = 4000;
  Draws draws(seed);
  std::vector<Scan> scans;
  for (int i = 0; i < kWalkSweeps; ++i) {
    Scan scan;
    scan.stamp_ns = kSweepNs * i;
    const Points points = World::Room().Sample(kPoints, 0.005, &draws);
    for (std::size_t k = 0; k < points.size(); ++k) {
      const double tau = from_s + 0.1 * static_cast<double>(k % 1000) / 1000.0;
      scan.points.push_back(ToScanPoint(SweepPoseAt(0.1 * i + tau).Inverse() * points[k]));
      scan.time_s.push_back(static_cast<float>(tau));
    }
    scans.push_back(std::move(scan));
  }
  return scans;
}

// Of no place.
void FillWithNoise(Scan* scan) {
  Draws draws(99);
  for (ScanPoint& p : scan->points) {
    Eigen::Vector3d at = draws.InCube(8.0);
    while (at.norm() < 2.0) at = draws.InCube(8.0);
    p = ToScanPoint(at);
  }
}

struct DamagedOutcome {
  std::vector<MappedScan> scans;
  std::map<std::size_t, FinalPose> poses;
  std::size_t pieces = 0;

  double ErrorM(std::size_t i) const {
    return (poses.at(i).pose.T_world_lidar.t - SweepPoseAt(0.1 * static_cast<double>(i)).t).norm();
  }
};

DamagedOutcome MappedDamaged(const std::vector<Scan>& scans) {
  DamagedOutcome outcome;
  MappingOptions options;
  options.loops.enabled = false;
  options.preparation.min_range_m = 0.2;
  MappingCallbacks callbacks;
  callbacks.on_final_pose = [&](const FinalPose& pose) { outcome.poses[pose.scan] = pose; };
  Mapping mapping(options, callbacks);
  for (const Scan& scan : scans) outcome.scans.push_back(mapping.Add(scan));
  mapping.Finish();
  outcome.pieces = mapping.counts().pieces;
  return outcome;
}

bool TrackedWhole(const MappedScan& scan) {
  return !scan.skipped && scan.odometry.status == OdometryFrame::Status::kTracked;
}

TEST(DamagedScans, WithoutDamageAllAreTracked) {
  const DamagedOutcome outcome = MappedDamaged(SweepsOf(1));
  for (std::size_t i = 1; i < kWalkSweeps; ++i) {
    EXPECT_TRUE(TrackedWhole(outcome.scans[i])) << i;
    EXPECT_LT(outcome.ErrorM(i), kGoodM) << i;
  }
}

TEST(DamagedScans, OnePointOfAnotherTimeCostsNoScan) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  for (const float time_s : {5.0F, -3.0F, 0.3F, -0.25F, 1e9F, kNone}) {
    std::vector<Scan> scans = SweepsOf(2);
    scans[kDamaged].time_s[77] = time_s;
    const DamagedOutcome outcome = MappedDamaged(scans);
    for (std::size_t i = 1; i < kWalkSweeps; ++i) {
      EXPECT_TRUE(TrackedWhole(outcome.scans[i])) << i << " of " << time_s;
      EXPECT_LT(outcome.ErrorM(i), kGoodM) << i << " of " << time_s;
    }
  }
}

// Wherever within a sweep its stamp is.
TEST(DamagedScans, ALostScanIsWhereItWasExpected) {
  for (const double from_s : {-0.1, -0.05, 0.0}) {
    std::vector<Scan> scans = SweepsOf(3, from_s);
    for (const int i : {kDamaged, kDamaged + 1}) FillWithNoise(&scans[static_cast<std::size_t>(i)]);
    const DamagedOutcome outcome = MappedDamaged(scans);
    EXPECT_EQ(outcome.scans[kDamaged].odometry.status, OdometryFrame::Status::kLost);
    for (std::size_t i = 1; i < kWalkSweeps; ++i) {
      const bool noise = i == kDamaged || i == kDamaged + 1;
      EXPECT_LT(outcome.ErrorM(i), noise ? 0.15 : kGoodM) << i << " of stamps at " << from_s;
    }
  }
}

TEST(DamagedScans, OneStampFarAheadCostsOneScan) {
  for (const StampNs ahead_ns : {StampNs{350'000'000}, StampNs{3'600'000'000'000}}) {
    std::vector<Scan> scans = SweepsOf(4);
    FillWithNoise(&scans[kDamaged]);
    scans[kDamaged].stamp_ns += ahead_ns;
    const DamagedOutcome outcome = MappedDamaged(scans);
    EXPECT_EQ(outcome.pieces, 1U);
    for (std::size_t i = 1; i < kWalkSweeps; ++i) {
      EXPECT_EQ(TrackedWhole(outcome.scans[i]), i != kDamaged) << i;
      EXPECT_EQ(outcome.poses.at(i).skipped, i == kDamaged) << i;
      if (i != kDamaged) {
        EXPECT_LT(outcome.ErrorM(i), kGoodM) << i;
      }
    }
  }
}

// With a stamp that is all but the same it is skipped; a part of a sweep later it counts.
TEST(DamagedScans, AScanThatComesTwiceIsNoMotion) {
  for (const StampNs later_ns : {1, 1'000, 100'000, 1'000'000, 5'000'000, 25'000'000}) {
    std::vector<Scan> scans = SweepsOf(5);
    Scan again = scans[kDamaged];
    again.stamp_ns += later_ns;
    scans.insert(scans.begin() + kDamaged + 1, again);
    const DamagedOutcome outcome = MappedDamaged(scans);
    EXPECT_EQ(outcome.pieces, 1U);
    for (std::size_t i = 1; i < scans.size(); ++i) {
      const std::size_t of = i <= kDamaged ? i : i - 1;
      const SE3& T = outcome.poses.at(i).pose.T_world_lidar;
      const bool skipped = i == kDamaged + 1 && later_ns < 20'000'000;
      EXPECT_EQ(outcome.scans[i].skipped, skipped) << i << " after " << later_ns;
      EXPECT_EQ(TrackedWhole(outcome.scans[i]), !skipped) << i << " after " << later_ns;
      EXPECT_LT((T.t - SweepPoseAt(0.1 * static_cast<double>(of)).t).norm(), kGoodM)
          << i << " after " << later_ns;
    }
  }
}

}  // namespace
}  // namespace lamina
