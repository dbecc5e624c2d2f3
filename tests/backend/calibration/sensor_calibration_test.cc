#include "backend/calibration/sensor_calibration.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/angle.h"
#include "frontend/scan/scan_clusters.h"
#include "tests/support/scenes/room_walk.h"

namespace lamina {
namespace {

Trajectory Straight(std::size_t count, double step_m) {
  Trajectory poses;
  for (std::size_t i = 0; i < count; ++i) {
    poses.push_back({static_cast<StampNs>(i) * 100000000,
                     SE3(Eigen::Quaterniond::Identity(), {step_m * static_cast<double>(i), 0, 0})});
  }
  return poses;
}

TEST(PickSegments, TakesFramesApartAndSpreadsTheSegments) {
  CalibrationOptions options;
  options.segments = 3;
  options.segment_frames = 10;
  options.frame_spacing_share = 0.05;
  const Trajectory poses = Straight(1000, 0.2);
  std::vector<bool> usable(poses.size(), true);
  usable[4] = false;
  // 0.5 m apart: every third frame.
  const auto segments = PickSegments(poses, usable, 10.0, options);
  ASSERT_EQ(segments.size(), 3U);
  for (const auto& segment : segments) {
    ASSERT_EQ(segment.size(), 10U);
    for (std::size_t i = 1; i < segment.size(); ++i) EXPECT_EQ(segment[i], segment[i - 1] + 3);
  }
  EXPECT_EQ(segments[0].front(), 0U);
  EXPECT_GT(segments[1].front(), 250U);
  EXPECT_GT(segments[2].front(), 550U);
}

TEST(PickSegments, FindsNoneWhereTheSensorStands) {
  const Trajectory poses = Straight(1000, 0.0);
  EXPECT_TRUE(
      PickSegments(poses, std::vector<bool>(1000, true), 10.0, CalibrationOptions()).empty());
}

CalibrationSegment SegmentOf(const std::vector<RoomBeam>& beams, int frames, unsigned seed) {
  CalibrationSegment segment;
  for (const RoomWalk::Stop& stop : RoomWalk(beams).Walk(frames, seed)) {
    CalibrationFrame frame;
    frame.stamp_ns = static_cast<StampNs>(segment.size());
    frame.T_world_lidar = stop.T_world_lidar;
    frame.measured = BuildScanClusters(stop.points, 0.8);
    segment.push_back(frame);
  }
  return segment;
}

std::vector<CalibrationSegment> Segments(const std::vector<RoomBeam>& beams, int count) {
  std::vector<CalibrationSegment> segments;
  for (int s = 0; s < count; ++s)
    segments.push_back(SegmentOf(beams, 10, static_cast<unsigned>(s)));
  return segments;
}

CalibrationResult Calibrate(std::vector<CalibrationSegment> segments) {
  return SensorCalibration(CalibrationOptions(), VoxelMapOptions(), SlidingWindowOptions())
      .Run(&segments);
}

TEST(SensorCalibration, FindsBothOffsets) {
  const CalibrationResult result = Calibrate(Segments(RoomRings(32, 0.4 * kDegree, 0.04), 5));
  ASSERT_EQ(result.status, CalibrationResult::Status::kConverged);
  EXPECT_TRUE(result.determined[0] && result.determined[1]);
  // Leaves that straddle the corners of so small a room mix two walls.
  EXPECT_NEAR(result.offsets(0) / kDegree, -0.4, 0.02);
  EXPECT_NEAR(result.offsets(1), -0.04, 0.003);
  EXPECT_LT(result.sigma(0) / kDegree, 0.02);
  EXPECT_LT(result.sigma(1), 0.005);
  EXPECT_LT(result.rounds.back().thickness_m, 0.95 * result.rounds.front().thickness_m);
}

TEST(SensorCalibration, LevelRingDoesNotDetermineElevation) {
  const CalibrationResult result = Calibrate(Segments({RoomBeam{0.0, 0.0, 0.04}}, 5));
  EXPECT_FALSE(result.determined[0]);
  EXPECT_EQ(result.offsets(0), 0.0);
  EXPECT_GT(result.sigma(0) / kDegree, CalibrationOptions().max_elevation_sigma_deg);
}

TEST(SensorCalibration, NothingSeenIsNotDetermined) {
  CalibrationSegment empty(5);
  const CalibrationResult result = Calibrate({empty, empty});
  EXPECT_EQ(result.status, CalibrationResult::Status::kNotDetermined);
  EXPECT_EQ(result.offsets, Intrinsics::Zero());
}

}  // namespace
}  // namespace lamina
