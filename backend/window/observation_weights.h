// Robust weight of each cluster of the window on the plane that it lies on.
//
// An object that stands before a wall for a few frames shares the wall's voxels, biases the plane
// towards itself and thickens it. So neither the plane nor its thickness may be taken from the map
// as they are: the kernel's scale is bounded by what thickness is usual among the planes of the
// window, and where clusters disagree with their plane, the plane is estimated again from all of
// its clusters under the weights so far, fixed ones included, and the weights from that plane.
//
// The weights are applied to the clusters before aggregation, held during a solve, and kept when
// the frame is marginalised.
//
// Private to backend/window.
#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "core/map/voxel_map.h"

namespace lamina {

struct WindowFrame;

class ObservationWeights {
 public:
  static constexpr std::int32_t kNone = -1;

  // Weighs all clusters of the frames, at the frames' present poses; the map must be refreshed.
  ObservationWeights(const VoxelMap& map, const std::deque<WindowFrame>& frames,
                     double kernel_sigma);

  // Number of the plane of cluster i of frame f, in the order in which planes are met; kNone if it
  // lies on none.
  std::int32_t PlaneOf(std::size_t f, std::size_t i) const { return plane_of_[f][i]; }
  // kUnknown where there is no plane.
  static constexpr double kUnknown = -1.0;
  const std::vector<double>& Weights(std::size_t f) const { return weights_[f]; }
  // The map's node of each plane.
  const std::vector<VoxelMap::NodeId>& nodes() const { return nodes_; }

 private:
  struct Support {  // of one plane
    Eigen::Vector3d mean, normal;
    double variance = 0.0;  // squared thickness, m^2
    double scale2 = 0.0;    // of its kernel, m^2
    bool contested = false;
  };
  void FindPlanes(const std::deque<WindowFrame>& frames);
  void ScaleKernels(double kernel_sigma);
  // Computes the weights of all clusters that are on a plane.
  void Weigh(const std::deque<WindowFrame>& frames);
  // Cluster `cluster` of frame `frame`.
  struct Use {
    std::uint32_t frame, cluster;
  };
  // The clusters on contested planes, in order.
  std::vector<Use> Contested() const;
  // Estimates their planes again from them, under their weights, and weighs them anew.
  void EstimateContested(const std::deque<WindowFrame>& frames, const std::vector<Use>& contested);
  double WeightOn(const Support& plane, const Eigen::Vector3d& p) const;

  const VoxelMap& map_;
  std::vector<std::vector<std::int32_t>> plane_of_;
  std::vector<std::vector<double>> weights_;
  std::vector<VoxelMap::NodeId> nodes_;
  std::vector<Support> planes_;
};

}  // namespace lamina
