// Laps round a block of a town, measured by a sensor that makes odometry drift.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "backend/mapping/options.h"
#include "tests/support/memory_scans.h"
#include "tests/support/scenes/submap_town.h"

namespace lamina {

// Poses every `step_m` round the block of 60 m, with corners of 20 m radius, for `way_m`.
inline std::vector<SE3> Laps(double step_m, double way_m) {
  constexpr double kEdge = 60.0, kRadius = 20.0, kLeg = kEdge - 2.0 * kRadius;
  constexpr double kArc = 0.5 * M_PI * kRadius;
  std::vector<SE3> poses;
  for (double s = 0.0; s < way_m; s += step_m) {
    const int corner = static_cast<int>(s / (kLeg + kArc));
    const double along = s - corner * (kLeg + kArc);
    double heading = 0.0;
    Eigen::Vector2d at(kRadius + std::min(along, kLeg), 0.0);
    if (along > kLeg) {
      heading = (along - kLeg) / kRadius;
      at += kRadius * Eigen::Vector2d(std::sin(heading), 1.0 - std::cos(heading));
    }
    const Eigen::Rotation2Dd turn(0.5 * M_PI * corner);
    const Eigen::Vector2d middle(0.5 * kEdge, 0.5 * kEdge);
    const Eigen::Vector2d p = middle + turn * (at - middle);
    poses.emplace_back(Eigen::Quaterniond(Eigen::AngleAxisd(0.5 * M_PI * corner + heading,
                                                            Eigen::Vector3d::UnitZ())),
                       Eigen::Vector3d(p.x(), p.y(), 1.7));
  }
  return poses;
}

// The laps' way between two lengths of it, driven in the other direction.
inline std::vector<SE3> LapsBack(double step_m, double from_m, double to_m) {
  std::vector<SE3> poses = Laps(step_m, from_m);
  poses.erase(poses.begin(), poses.begin() + static_cast<std::ptrdiff_t>(to_m / step_m));
  std::reverse(poses.begin(), poses.end());
  const SE3 turned(ExpSO3({0.0, 0.0, M_PI}), Eigen::Vector3d::Zero());
  for (SE3& pose : poses) pose = pose * turned;
  return poses;
}

// What a sensor sees that measures too long to its left and too short to its right, by this share:
// its odometry turns.
inline std::vector<Scan> CrookedScans(const Town& town, const std::vector<SE3>& truth, double share,
                                      double per_m2 = 4.0) {
  Draws draws(5);
  std::vector<Scan> scans;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    Scan scan;
    scan.stamp_ns = 100'000'000LL * static_cast<StampNs>(i);
    const SE3 T_lidar_world = truth[i].Inverse();
    for (const Eigen::Vector3d& p : town.Seen(truth[i].t, 26.0, per_m2, &draws)) {
      const Eigen::Vector3d seen = T_lidar_world * p;
      const double azimuth = std::atan2(seen.y(), seen.x());
      scan.points.push_back(ToScanPoint((1.0 + share * std::sin(azimuth)) * seen));
    }
    scans.push_back(std::move(scan));
  }
  return scans;
}

// Options under which such laps close, round the block.
inline MappingOptions LapOptions(bool loops = true) {
  MappingOptions options;
  options.preparation.deskew = ScanPreparationOptions::Deskew::kOff;
  options.mapper.backend.window.frames = 8;
  options.loops.enabled = loops;
  options.loops.submap.length_m = 20.0;
  options.loops.min_way_m = 60.0;
  options.loops.hand_over_lag_keyframes = 4;
  options.loops.reach_m = 60.0;
  return options;
}

}  // namespace lamina
