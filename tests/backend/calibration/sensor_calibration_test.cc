#include "backend/calibration/sensor_calibration.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/angle.h"
#include "tests/support/scenes/random_rooms.h"

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

// A sensor that walks through a room, with rays of given elevations, each range measured too long
// by `range_m` and each elevation too high by `elevation_rad`.
class RoomWalk {
 public:
  RoomWalk(double elevation_rad, double range_m, const std::vector<double>& elevations_deg)
      : elevation_(elevation_rad), range_(range_m), elevations_(elevations_deg) {}

  CalibrationSegment Walk(int frames, unsigned seed) const {
    Draws draws(seed);
    CalibrationSegment segment;
    for (int i = 0; i < frames; ++i) {
      CalibrationFrame frame;
      frame.stamp_ns = i;
      frame.T_world_lidar = SE3(ExpSO3({0, 0, draws.Uniform(-3.0, 3.0)}),
                                {draws.Uniform(-3.0, 3.0), draws.Uniform(-2.0, 2.0), 0.0});
      frame.measured = BuildScanClusters(Scan(frame.T_world_lidar, &draws), 0.8);
      segment.push_back(frame);
    }
    return segment;
  }

 private:
  // Distance along a ray of the box |x| < 6.3, |y| < 4.3, -1.4 < z < 1.7.
  static double Range(const Eigen::Vector3d& p, const Eigen::Vector3d& d) {
    const Eigen::Vector3d low(-6.3, -4.3, -1.4), high(6.3, 4.3, 1.7);
    double nearest = 1e9;
    for (int i = 0; i < 3; ++i) {
      if (std::abs(d(i)) < 1e-12) continue;
      nearest = std::min(nearest, ((d(i) > 0.0 ? high(i) : low(i)) - p(i)) / d(i));
    }
    return nearest;
  }
  std::vector<TimedPoint> Scan(const SE3& T, Draws* draws) const {
    std::vector<TimedPoint> points;
    for (const double elevation : elevations_) {
      for (int a = 0; a < 720; ++a) {
        const double azimuth = a * kDegree / 2.0, e = elevation * kDegree;
        const auto ray = [&](double up) {
          return Eigen::Vector3d(std::cos(azimuth) * std::cos(up), std::sin(azimuth) * std::cos(up),
                                 std::sin(up));
        };
        const double range = Range(T.t, T.q * ray(e)) + range_ + draws->Normal(0.01);
        const Eigen::Vector3f p = (range * ray(e + elevation_)).cast<float>();
        points.push_back({p.x(), p.y(), p.z(), 0.0F});
      }
    }
    return points;
  }

  double elevation_, range_;
  std::vector<double> elevations_;
};

std::vector<double> Rings(int count) {
  std::vector<double> elevations;
  for (int i = 0; i < count; ++i) elevations.push_back(-25.0 + 50.0 * i / (count - 1));
  return elevations;
}

std::vector<CalibrationSegment> Segments(const RoomWalk& room, int count) {
  std::vector<CalibrationSegment> segments;
  for (int s = 0; s < count; ++s) segments.push_back(room.Walk(10, static_cast<unsigned>(s)));
  return segments;
}

CalibrationResult Calibrate(std::vector<CalibrationSegment> segments) {
  return SensorCalibration(CalibrationOptions(), VoxelMapOptions(), SlidingWindowOptions())
      .Run(&segments);
}

TEST(SensorCalibration, FindsBothOffsets) {
  const CalibrationResult result = Calibrate(Segments(RoomWalk(0.4 * kDegree, 0.04, Rings(32)), 5));
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
  const CalibrationResult result = Calibrate(Segments(RoomWalk(0.0, 0.04, {0.0}), 5));
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
