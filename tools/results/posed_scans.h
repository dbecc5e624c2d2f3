// Scans of a recording together with the poses that some trajectory gives them: what judging a
// trajectory by its map, and exporting that map, both start from.
//
// A scan is taken while the sensor moves. With xi the body twist at scan i (rad/s, m/s) and a its
// change, a point p measured tau seconds after the scan's stamp stands, in the LiDAR frame of the
// stamp, at
//
//     p' = Exp(tau xi + tau^2/2 a) p
//
// xi and a are those of core/geometry/sweep_motion.h; tau comes from PrepareScan
// (frontend/scan/scan_preparation.h).
#pragma once

#include <cstddef>
#include <vector>

#include "core/geometry/scan.h"
#include "core/geometry/sweep_motion.h"
#include "frontend/scan/scan_preparation.h"
#include "io/recording/scan_source.h"

namespace lamina {

struct PosedScan {
  std::size_t scan = 0;  // position in the ScanSource
  SE3 T_world_lidar;
  SweepMotion sweep;
  // The mean of the motions from the pose before and to the one after, or the one that exists: what
  // trajectories are judged by, those of others too.
  Vector6d mean_twist = Vector6d::Zero();
};

std::vector<StampNs> ScanStamps(const ScanSource& scans);

// The scans that have a pose within `tolerance_s` of their stamp, in the order of their stamps;
// scans without one (skipped by a run, say) are left out. May be empty.
std::vector<PosedScan> PoseScans(const ScanSource& scans, const Trajectory& trajectory,
                                 double tolerance_s);

// A time to pass to PrepareScan for scan i. Unlike a live run, it knows the stamps that follow: so
// the first scans of a recording have the right period too. `fallback_s` where stamps tell nothing.
double SweepPeriodOfScan(const ScanSource& scans, std::size_t i, double fallback_s);
// The usual time between scans around scan i, however long.
double TimeBetweenScans(const ScanSource& scans, std::size_t i, double fallback_s);

// p -> Exp(tau xi + tau^2/2 a) p for many points of one scan. Thread-safe once constructed.
class SweepDeskew {
 public:
  explicit SweepDeskew(const SweepMotion& sweep);
  Eigen::Vector3d operator()(const TimedPoint& p) const;

 private:
  Eigen::Vector3d Steady(const Eigen::Vector3d& x, double tau) const;

  SweepMotion sweep_;
  bool steady_;                 // no acceleration
  double rate_;                 // |w|, rad/s
  Eigen::Vector3d axis_;        // w / |w|, zero if there is no rotation
  Eigen::Vector3d velocity_;    // v
  Eigen::Vector3d bent_once_;   // axis x v / rate
  Eigen::Vector3d bent_twice_;  // axis x (axis x v) / rate
};

}  // namespace lamina
