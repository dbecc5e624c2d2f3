// Batches of frames with known poses, and registrations of them.
#pragma once

#include <algorithm>
#include <vector>

#include "backend/bundle/formulations/registry.h"
#include "backend/registration/batch_registration.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {

inline VoxelMapOptions Voxels() {
  VoxelMapOptions map;
  map.root_size_m = 0.5;
  map.max_cluster_weight = 1e6;
  return map;
}

inline BatchRegistration Registration(RegistrationOptions options = {},
                                      const Formulation& formulation = CondensedFormulation()) {
  return BatchRegistration(options, Voxels(), SlidingWindowOptions(), formulation);
}

struct Batch {
  std::vector<SE3> truth;
  std::vector<BatchFrame> frames;
};

inline BatchFrame FrameAt(const SE3& truth, const SE3& start, const Points& world,
                          std::size_t number) {
  BatchFrame frame;
  frame.stamp_ns = static_cast<StampNs>(number) * 1000000000;
  frame.T_world_lidar = start;
  Points seen;
  for (const Eigen::Vector3d& p : world) seen.push_back(truth.Inverse() * p);
  frame.clusters = BuildScanClusters(StillPoints(seen), Voxels().LeafSize());
  frame.points = GroupByCluster(StillPoints(seen), Voxels().LeafSize());
  return frame;
}

// Poses in the middle of a world, each starting off by exactly this much; the first is exact.
inline Batch Batches(const World& world, int frames, double off_rad, double off_m, Draws* draws) {
  Batch batch;
  for (int k = 0; k < frames; ++k) {
    const SE3 truth = k == 0 ? SE3() : draws->Offset(0.3, 0.4);
    const SE3 off = k == 0 ? SE3() : draws->Offset(off_rad, off_m);
    batch.truth.push_back(truth);
    batch.frames.push_back(FrameAt(truth, SE3(truth.q * off.q, truth.t + off.t),
                                   world.Sample(2000, 0.005, draws), static_cast<std::size_t>(k)));
  }
  return batch;
}

inline double LargestBatchError(const std::vector<SE3>& a, const std::vector<SE3>& b) {
  double largest = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    largest = std::max({largest, RotationAngle(a[k], b[k]), (a[k].t - b[k].t).norm()});
  }
  return largest;
}

}  // namespace lamina
