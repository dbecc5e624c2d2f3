// The voxels of one grid in which a steady motion is judged (steady_motion.h).
//
// Private to frontend/start.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/map/voxel_key.h"
#include "frontend/start/steady_motion.h"

namespace lamina {

// Voxels with what all scans put into them, in the order in which they come up. One
// after another is filled: memory stays.
struct SteadyMotionGrid {
  void Begin(std::size_t clusters);
  // Voxels of a scan's clusters, moved along u by the way and by the speed times the time of each.
  // What is judged in space has voxels of its own.
  void FindVoxels(const SteadyScan& scan, const char* is_in_space, const Eigen::Vector3d& u,
                  double way_m, double speed_m_s, const Eigen::Vector3d& shift_m,
                  double inverse_size);
  // What was found goes into its voxels.
  void AddScan(const SteadyScan& scan, const char* is_in_space, std::size_t number);

  VoxelIndex index;
  std::vector<PointCluster> voxels;
  std::vector<std::size_t> first_scan;  // of each voxel
  std::vector<char> shared;             // whether several scans see it
  std::vector<char> in_space;           // whether it is judged there, not in the plan
  std::vector<std::int32_t> voxel_of;   // of each cluster of the scans so far

 private:
  // So many clusters ahead memory is asked for.
  static constexpr std::size_t kAhead = 8;

  std::vector<Eigen::Vector3d> means_;  // of the scan at hand
  std::vector<VoxelKey> keys_;
};

}  // namespace lamina
