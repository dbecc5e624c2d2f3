#include "frontend/scan/scan_preparation.h"
#include "core/base/angle.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

using Deskew = ScanPreparationOptions::Deskew;

ScanPoint ToScanPoint(const Eigen::Vector3d& p) {
  return {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), 0.0F};
}
Eigen::Vector3d ToVector(const ScanPoint& p) { return {p.x, p.y, p.z}; }

Scan RandomScan(int count, Draws* draws) {
  Scan scan;
  while (static_cast<int>(scan.points.size()) < count) {
    scan.points.push_back(ToScanPoint(draws->Uniform(3.0, 50.0) * draws->Direction()));
  }
  return scan;
}

ScanPreparationOptions Azimuth() {
  ScanPreparationOptions options;
  options.deskew = Deskew::kAzimuth;
  return options;
}

TEST(ScanPreparation, DropsWhatIsNotFiniteOrOutOfRangeAndCountsIt) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  Scan scan;
  scan.points = {{kNan, 1, 1, 0},   {5, kInf, 1, 0}, {5, 0, -kInf, 0}, {1.9F, 0, 0, 0},
                 {0, 101.0F, 0, 0}, {1e9F, 0, 0, 0}, {1e30F, 0, 0, 0}, {-1e38F, 1e38F, 0, 0},
                 {0, 0, 0, 0},      {2.1F, 0, 0, 0}, {0, 0, -99.0F, 0}};
  const PreparedScan prepared = PrepareScan(scan, ScanPreparationOptions(), 0.1);
  EXPECT_EQ(prepared.non_finite, 3U);
  EXPECT_EQ(prepared.out_of_range, 6U);
  ASSERT_EQ(prepared.points.size(), 2U);
  EXPECT_EQ(prepared.points[0].x, 2.1F);
  EXPECT_EQ(prepared.points[1].z, -99.0F);
}

TEST(ScanPreparation, TimeOfAKittiSweepFollowsTheAzimuth) {
  Draws draws(1);
  const Scan scan = RandomScan(20000, &draws);
  const PreparedScan prepared = PrepareScan(scan, Azimuth(), 0.1);
  ASSERT_EQ(prepared.points.size(), scan.points.size());
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const double azimuth =
        std::atan2(static_cast<double>(scan.points[i].y), static_cast<double>(scan.points[i].x));
    const double fraction = 0.5 * (1.0 - azimuth / M_PI);
    if (fraction < 1e-4 || fraction > 1.0 - 1e-4) continue;  // at the cut either end is right
    EXPECT_NEAR(prepared.points[i].time_s, 0.1 * (fraction - 0.5), 0.1 * 1e-5);
  }
}

TEST(ScanPreparation, SweepOptionsTurnShiftAndStretchTheTimes) {
  Scan scan;
  scan.points = {{5, 0, 0, 0}, {0, 5, 0, 0}, {-5, 0.001F, 0, 0}, {0, -5, 0, 0}};
  ScanPreparationOptions options = Azimuth();
  options.rotation = ScanPreparationOptions::Rotation::kCounterclockwise;
  options.sweep_start_azimuth_deg = -45.0;
  options.stamp_at_sweep_fraction = 0.0;
  options.sweep_period_s = 0.8;
  const PreparedScan prepared = PrepareScan(scan, options, 0.1);
  ASSERT_EQ(prepared.points.size(), 4U);
  EXPECT_NEAR(prepared.points[0].time_s, 0.1, 1e-4);
  EXPECT_NEAR(prepared.points[1].time_s, 0.3, 1e-4);
  EXPECT_NEAR(prepared.points[2].time_s, 0.5, 1e-3);
  EXPECT_NEAR(prepared.points[3].time_s, 0.7, 1e-4);
}

TEST(ScanPreparation, TimesOfTheFileAreUsedWhereAskedFor) {
  Scan scan;
  scan.points = {{5, 0, 0, 0}, {0.5F, 0, 0, 0}, {0, 5, 0, 0}, {0, 0, 5, 0}};
  scan.time_s = {0.01F, 0.02F, -0.03F, std::numeric_limits<float>::quiet_NaN()};
  ScanPreparationOptions options;
  for (const Deskew deskew : {Deskew::kAuto, Deskew::kTime}) {
    options.deskew = deskew;
    const PreparedScan prepared = PrepareScan(scan, options, 0.1);
    ASSERT_EQ(prepared.points.size(), 2U);
    EXPECT_EQ(prepared.points[0].time_s, 0.01F);
    EXPECT_EQ(prepared.points[1].time_s, -0.03F);
    EXPECT_EQ(prepared.out_of_time, 1U);
  }
  options.deskew = Deskew::kOff;
  const PreparedScan off = PrepareScan(scan, options, 0.1);
  ASSERT_EQ(off.points.size(), 3U);
  EXPECT_EQ(off.points[0].time_s, 0.0F);
}

TEST(ScanPreparation, VerticalCorrectionTurnsAboutThePointsOwnHorizontalAxis) {
  Draws draws(2);
  const Scan scan = RandomScan(2000, &draws);
  ScanPreparationOptions options;
  options.vertical_correction_deg = 0.205;
  const PreparedScan prepared = PrepareScan(scan, options, 0.1);
  ASSERT_EQ(prepared.points.size(), scan.points.size());
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const Eigen::Vector3d p = ToVector(scan.points[i]);
    const Eigen::Vector3d axis = p.cross(Eigen::Vector3d::UnitZ()).normalized();
    const Eigen::Vector3d expected = ExpSO3(0.205 * kDegree * axis) * p;
    const Eigen::Vector3d got(prepared.points[i].x, prepared.points[i].y, prepared.points[i].z);
    EXPECT_LT((got - expected).norm(), 1e-6 * p.norm());
    if (std::abs(p.z()) < 0.5 * p.norm()) {
      EXPECT_GT(got.z(), p.z());
    }
  }
  // Straight above the sensor there is no such axis.
  Scan zenith;
  zenith.points = {{0, 0, 5, 0}};
  EXPECT_EQ(PrepareScan(zenith, options, 0.1).points.at(0).z, 5.0F);
}

TEST(ScanPreparation, RangeOffsetStretchesEveryRayAndMixesWithTheVerticalCorrection) {
  Draws draws(3);
  const Scan scan = RandomScan(500, &draws);
  ScanPreparationOptions options;
  options.range_offset_m = -0.07;
  options.vertical_correction_deg = 0.3;
  const PreparedScan prepared = PrepareScan(scan, options, 0.1);
  options.range_offset_m = 0.0;
  const PreparedScan turned = PrepareScan(scan, options, 0.1);
  ASSERT_EQ(prepared.points.size(), scan.points.size());
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const Eigen::Vector3d p(turned.points[i].x, turned.points[i].y, turned.points[i].z);
    const Eigen::Vector3d got(prepared.points[i].x, prepared.points[i].y, prepared.points[i].z);
    EXPECT_LT((got - (p.norm() - 0.07) * p.normalized()).norm(), 2e-6 * p.norm());
  }
}

TEST(SweepPeriod, ScansThatWerePickedAreNoSweepApart) {
  constexpr StampNs kMs = 1000000;
  EXPECT_NEAR(SweepPeriod({0, 200 * kMs, 400 * kMs}, 0.1), 0.2, 1e-12);
  EXPECT_EQ(SweepPeriod({0, 500 * kMs, 1000 * kMs}, 0.1), 0.1);
  EXPECT_EQ(SweepPeriod({0, 100 * kMs, 500 * kMs, 900 * kMs}, 0.1), 0.1);
}

TEST(SweepPeriod, IsTheMedianOfRecentDifferences) {
  constexpr StampNs kMs = 1000000;
  EXPECT_EQ(SweepPeriod({}, 0.25), 0.25);
  EXPECT_EQ(SweepPeriod({5 * kMs}, 0.25), 0.25);
  EXPECT_EQ(SweepPeriod({5 * kMs, 5 * kMs}, 0.25), 0.25);
  std::vector<StampNs> stamps = {0};
  for (int i = 0; i < 30; ++i) stamps.push_back(stamps.back() + 500 * kMs);
  for (int i = 0; i < 9; ++i) stamps.push_back(stamps.back() + (i == 4 ? 200 : 100) * kMs);
  EXPECT_NEAR(SweepPeriod(stamps, 0.25), 0.1, 1e-12);  // neither the old rate nor the dropped scan
  stamps.push_back(stamps.back() - 50 * kMs);          // a step back is no period
  EXPECT_NEAR(SweepPeriod(stamps, 0.25), 0.1, 1e-12);
}

TEST(ScanPreparation, PointsComeInTheFrameOfTheVehicleWithRangesAndTimesOfTheSensor) {
  Scan scan;
  scan.points = {{1.5F, 0, 0, 0}, {4, 0, 1, 0}, {0, 12, 0, 0}};
  scan.time_s = {0.01F, 0.02F, 0.03F};
  ScanPreparationOptions options;
  options.min_range_m = 2.0;
  options.max_range_m = 10.0;
  // Looks back from 3 m behind: its first point is 4.5 m away from the vehicle's origin.
  const SE3 T_vehicle_lidar(ExpSO3({0, 0, M_PI}), {-3, 0, 2});
  const PreparedScan prepared = PrepareScan(scan, options, 0.1, T_vehicle_lidar);
  ASSERT_EQ(prepared.points.size(), 1U);
  EXPECT_EQ(prepared.out_of_range, 2U);
  EXPECT_NEAR(prepared.points[0].x, -7.0F, 1e-5F);
  EXPECT_NEAR(prepared.points[0].y, 0.0F, 1e-5F);
  EXPECT_NEAR(prepared.points[0].z, 3.0F, 1e-5F);
  EXPECT_EQ(prepared.points[0].time_s, 0.02F);
}

}  // namespace
}  // namespace lamina
