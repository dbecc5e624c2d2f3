// The first scans of a drive, and the motions and maps that given poses of them lead to.
//
// `poses`: T_world_lidar of the scans in their order, of all or of the first ones. Scan k is
// deskewed by the mean body twist between the poses k - 1 and k plus StartScan::sweep.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/scan.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"
#include "core/geometry/sweep_motion.h"
#include "core/map/voxel_map.h"

namespace lamina {

struct StartScan {
  StampNs stamp_ns = 0;
  std::vector<TimedCluster> clusters;
  SE3 T_world_lidar;
  // While the start is open: the motion found from a shaken scan itself, its twist less the mean
  // twist since the previous scan; zero for other scans. Once StartTrack has overruled odometry:
  // the whole motion during the scan.
  SweepMotion sweep;

  void Archive(StateArchive& a) {
    a(&stamp_ns, &clusters, &T_world_lidar, &sweep.twist, &sweep.acceleration, &sweep.of_scan);
  }
};

// Its const members are thread-safe.
class StartScans {
 public:
  explicit StartScans(const VoxelMapOptions& map_options) : map_options_(map_options) {}

  void Add(StartScan scan) { scans_.push_back(std::move(scan)); }
  void Clear() { scans_.clear(); }
  std::vector<StartScan>& all() { return scans_; }
  const std::vector<StartScan>& all() const { return scans_; }
  std::size_t size() const { return scans_.size(); }
  bool empty() const { return scans_.empty(); }
  const StartScan& operator[](std::size_t scan) const { return scans_[scan]; }

  // T_world_lidar of each scan: as odometry estimated it, as long as the start is open.
  std::vector<SE3> OwnPoses() const;
  // Seconds from the previous scan to this one, and from the first scan to the last.
  double GapS(std::size_t scan) const;
  double LengthS() const;
  // Body twist at a scan, per second, from the motion since the one before; at the first, that of
  // the second.
  Vector6d Twist(const std::vector<SE3>& poses, std::size_t scan) const;
  // Motion during a scan: that twist plus StartScan::sweep.
  SweepMotion Sweep(const std::vector<SE3>& poses, std::size_t scan) const;
  // A scan deskewed by that motion, in its LiDAR frame.
  std::vector<PointCluster> Deskewed(std::size_t scan, const std::vector<SE3>& poses) const;
  // Map of the scans [0, scans) at these poses, deskewed, without scan `without`; kNone leaves out
  // none.
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  VoxelMap MapOf(const std::vector<SE3>& poses, std::size_t scans,
                 std::size_t without = kNone) const;
  // Sum of n n^T over the planes that the newest scan meets in the map of the scans [0, scans).
  Eigen::Matrix3d Faced(const std::vector<SE3>& poses, std::size_t scans) const;

  void Archive(StateArchive& a) { a(&scans_); }

 private:
  VoxelMapOptions map_options_;
  std::vector<StartScan> scans_;
};

// The direction that the fewest planes face: the eigenvector of StartScans::Faced with the smallest
// eigenvalue.
Eigen::Vector3d LeastFaced(const Eigen::Matrix3d& faced);

// The largest distance between two ways.
double Apart(const std::vector<SE3>& a, const std::vector<SE3>& b);
// Whether a way stays within 0.3 m of where it begins.
bool Stands(const std::vector<SE3>& way);

}  // namespace lamina
