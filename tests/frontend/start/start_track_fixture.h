// Scans of a street among vans, and what odometry made of them.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/base/angle.h"
#include "frontend/start/start_track.h"
#include "tests/support/scenes/bay_street.h"

namespace lamina {

// The sensor drives at 3 m/s, in a row of vans on either side that do so on the whole.
inline constexpr double kSpeedM = 3.0, kPeriodS = 0.1;

struct Van {
  double x, y, rate, phase;

  double AlongAt(double t) const { return x + 1.1 * std::sin(rate * t + phase); }
};

// Range to an upright box about `centre`; infinite where the ray misses it.
inline double CastBox(const Eigen::Vector3d& centre, const Eigen::Vector3d& half,
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
    frame.match.clusters = frame.match.matched = 1000;
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

}  // namespace lamina
