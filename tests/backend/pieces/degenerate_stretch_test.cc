// A corridor between two rooms: along it nothing tells how far the sensor has come.
#include "backend/pieces/degenerate_stretch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <utility>

#include "backend/mapping/mapping.h"
#include "tests/support/memory_scans.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

// Both ends of the corridor are walls with a niche.
constexpr double kBeginM = -5.0, kEndM = 40.0;
constexpr double kRangeM = 8.0, kScanPeriodS = 0.1;

World CorridorWorld() {
  const double middle = 0.5 * (kBeginM + kEndM), half = 0.5 * (kEndM - kBeginM);
  World world{{{{middle, 2.1, 0}, {half, 0, 0}, {0, 0, 1.5}},
               {{middle, -1.9, 0}, {half, 0, 0}, {0, 0, 1.5}},
               {{middle, 0, -1.4}, {half, 0, 0}, {0, 2, 0}}}};
  for (const double x : {kBeginM, kEndM}) {
    const double inwards = x < 0.0 ? 0.6 : -0.6;
    world.facets.push_back({{x, 0.8, 0}, {0, 1.2, 0}, {0, 0, 1.5}});
    world.facets.push_back({{x + inwards, -1.1, 0}, {0, 0.8, 0}, {0, 0, 1.5}});
  }
  return world;
}

Scan ScanAt(double x, StampNs stamp_ns, Draws* draws) {
  Scan scan;
  scan.stamp_ns = stamp_ns;
  for (const Eigen::Vector3d& p : CorridorWorld().Sample(4000, 0.01, draws)) {
    const Eigen::Vector3d seen = p - Eigen::Vector3d(x, 0.0, 0.0);
    if (seen.norm() < kRangeM) scan.points.push_back(ToScanPoint(seen));
  }
  return scan;
}

struct Crossed {
  std::int64_t pieces = 0;
  int tracked_after = 0;  // scans that are neither lost nor degenerate, after the blind part
  double worst_m = 0.0;   // error of those, and of the ones before, in the frame of their piece
};

// `way_m` by time; scans from `after_s` on see a room again.
Crossed Cross(const std::function<double(double)>& way_m, double seconds, double after_s,
              double restart_after_sigma_m, bool stamps_made_up = false) {
  Draws draws(3);
  MappingOptions options;
  options.preparation.min_range_m = 0.5;
  options.mapper.backend.restart_after_sigma_m = restart_after_sigma_m;
  Mapping mapping(options, {});
  Crossed crossed;
  double estimated_first = 0.0, true_first = 0.0;
  for (int i = 0; i * kScanPeriodS < seconds; ++i) {
    const double x = way_m(i * kScanPeriodS);
    Scan seen = ScanAt(x, i * StampNs{100'000'000}, &draws);
    seen.stamp_made_up = stamps_made_up;
    const MappedScan scan = mapping.Add(std::move(seen));
    const Eigen::Vector3d& t = scan.odometry.T_world_lidar.t;
    if (scan.began_piece) {
      estimated_first = t.x();
      true_first = x;
      crossed.pieces = scan.piece + 1;
      continue;
    }
    if (scan.odometry.status != OdometryFrame::Status::kTracked ||
        scan.odometry.match.degenerate > 0)
      continue;
    crossed.tracked_after += i * kScanPeriodS > after_s ? 1 : 0;
    crossed.worst_m =
        std::max(crossed.worst_m, std::abs((t.x() - estimated_first) - (x - true_first)));
  }
  mapping.Finish();
  return crossed;
}

// On at 2 m/s, in the blind part at 1.5 m/s.
double Through(double t) { return t < 5.0 ? 2.0 * t : 10.0 + 1.5 * (t - 5.0); }

TEST(DegenerateStretch, WhatComesAfterItIsAPieceOfItsOwn) {
  const Crossed crossed = Cross(Through, 24.0, 20.5, 0.1);
  EXPECT_EQ(crossed.pieces, 2);
  EXPECT_GT(crossed.tracked_after, 20);
  EXPECT_LT(crossed.worst_m, 0.1);
}

TEST(DegenerateStretch, InOnePieceWhereThatIsWantedAtTheCostOfWhatItLeavesOpen) {
  const Crossed crossed = Cross(Through, 24.0, 20.5, 0.0);
  EXPECT_EQ(crossed.pieces, 1);
  EXPECT_GT(crossed.worst_m, 0.5);
}

// Of the blind part few scans were kept, farther apart than those before: a clock would tell.
double InLeaps(double t) {
  constexpr double kLeapAfterS = 1.5, kShortStepM = 0.2, kLongStepM = 11.0, kBeyondM = 34.0;
  const double before = kShortStepM / kScanPeriodS * std::min(t, kLeapAfterS);
  const double leapt = before + kLongStepM / kScanPeriodS * std::max(0.0, t - kLeapAfterS);
  if (leapt < kBeyondM) return leapt;
  const double there_s = kLeapAfterS + (kBeyondM - before) * kScanPeriodS / kLongStepM;
  return kBeyondM + kShortStepM / kScanPeriodS * std::min(t - there_s, 1.0);
}

TEST(DegenerateStretch, WithoutStampsAFewScansLeaveAsMuchOpen) {
  const Crossed crossed = Cross(InLeaps, 6.0, 4.0, 0.1, /*stamps_made_up=*/true);
  EXPECT_EQ(crossed.pieces, 2);
  EXPECT_GT(crossed.tracked_after, 5);
  EXPECT_LT(crossed.worst_m, 0.1);
}

// In for a second, and back out to the room that it came from.
TEST(DegenerateStretch, BackWhereItCameFromThePieceGoesOn) {
  const auto in_and_out = [](double t) { return 1.5 - 1.5 * std::cos(2.0 * M_PI * t / 10.0); };
  const Crossed crossed = Cross(in_and_out, 10.0, 6.0, 0.1);
  EXPECT_EQ(crossed.pieces, 1);
  EXPECT_GT(crossed.tracked_after, 20);
  EXPECT_LT(crossed.worst_m, 0.1);
}

}  // namespace
}  // namespace lamina
