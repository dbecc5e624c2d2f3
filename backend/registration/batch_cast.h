// A batch of frames cast into one voxel map at given poses, and the bundle problem of what they see
// together there.
//
// Of a frame nothing is kept but its packed clusters, which are the caller's, and a number for
// each: they are unpacked, deskewed and moved once for the map, once to find their planes and once
// for their observations, a few frames at a time, each time the same.
//
// What some frames see from one side of a plane and others from the other is two planes, the faces
// of a wall or a door, however thin. While poses are off by more than its thickness, nothing else
// tells them apart, and as one plane they draw the rooms on both sides into one another.
//
// Weights are those of the sliding window (SlidingWindowOptions): caps and a robust kernel on the
// observations, 1 / variance on the planes, as the map has both.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "backend/bundle/problem.h"
#include "backend/registration/batch_frame.h"
#include "backend/window/sliding_window.h"
#include "core/geometry/sweep_motion.h"
#include "core/map/voxel_map.h"

namespace lamina {

class BatchCast {
 public:
  // Keeps references. Deterministic at any number of threads.
  BatchCast(const std::vector<BatchFrame>& frames, const std::vector<SE3>& poses,
            const VoxelMapOptions& map, const SlidingWindowOptions& weights);

  const VoxelMap& map() const { return map_; }
  // No priors: no odometry stands behind these poses.
  BundleProblem Problem(bool with_points) const;
  // How far apart the frames lie on what they see: root mean square of the distances of all
  // clusters to planes that two frames or more have made, each cut off at kernel_sigma noise
  // floors, which clusters on no such plane count as. So torn frames count as much as thick planes
  // do, and a cluster as much as any other, however many points it has. Metres; 0 without clusters.
  double Misfit() const;

 private:
  // Number of the plane of each cluster of each frame; kNone if it is on none that counts.
  using PlaneNumbers = std::vector<std::vector<std::int32_t>>;
  static constexpr std::int32_t kNone = -1;

  // Of frame k, LiDAR frame at its stamp.
  std::vector<PointCluster> Deskewed(std::size_t k) const;
  // Numbers the planes in the order in which they are met: *planes with their counts and weights,
  // first being the number, and *nodes, the map's node of each number.
  PlaneNumbers NumberPlanes(std::vector<Plane>* planes, std::vector<VoxelMap::NodeId>* nodes) const;
  // Fills in the observations of the problem's planes, in their order. place[number] is that of a
  // plane among them; kNone for what has been left out.
  void FillIn(const PlaneNumbers& numbers, const std::vector<VoxelMap::NodeId>& nodes,
              const std::vector<std::int32_t>& place, bool with_points,
              BundleProblem* problem) const;
  void AddPoints(std::size_t k, std::size_t cluster, double weight,
                 std::vector<WeightedPoint>* points) const;

  const std::vector<BatchFrame>& frames_;
  const std::vector<SE3>& poses_;
  const SlidingWindowOptions weights_;
  VoxelMap map_;
  std::vector<SweepMotion> sweeps_;
  std::vector<std::vector<VoxelMap::NodeId>> leaves_;  // of each cluster of each frame
};

// The other judge of a batch's poses (BatchCast::Misfit): a cast at these poses into this map has
// voxels of another size at other places than those whose planes have been fitted to them.
struct OtherVoxels {
  OtherVoxels(const VoxelMapOptions& fitted, const std::vector<SE3>& fitted_poses);

  VoxelMapOptions map;
  std::vector<SE3> poses;
};

}  // namespace lamina
