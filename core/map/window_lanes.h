// Clusters that join the window parts of the map's leaves or are exchanged there, four at a time.
// Private to core/map.
#pragma once

#include <cstddef>

#include "core/geometry/cluster_moments.h"
#include "core/map/voxel_key.h"

namespace lamina {

// Up to four clusters and the windows that they go to, which may be the same: they are served one
// after the other, with the bits of ClusterMoments.
class FourWindows {
 public:
  explicit FourWindows(double root_size_m) : root_size_m_(root_size_m) {}

  // `root`: the key of the leaf's root. `after`: what the cluster is exchanged for. All of them
  // must last until they are served.
  void Take(VoxelKey root, const PointCluster& cluster, ClusterMoments* window,
            const PointCluster* after = nullptr) {
    roots_[count_] = root;
    clusters_[count_] = &cluster;
    after_[count_] = after;
    windows_[count_] = window;
    ++count_;
  }
  bool full() const { return count_ == 4; }

  // All that were taken are added, or exchanged; there are none thereafter.
  void Add();
  void Exchange();

 private:
  double root_size_m_;
  std::size_t count_ = 0;
  VoxelKey roots_[4];
  const PointCluster *clusters_[4], *after_[4];
  ClusterMoments* windows_[4];
};

}  // namespace lamina
