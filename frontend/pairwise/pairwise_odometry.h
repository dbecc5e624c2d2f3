// A sequence of scans, registered one after the other by a pairwise method.
//
//   frame to frame   scan k against scan k - 1; motions are chained
//   frame to map     scan k against scan k - 1 first, then from there against the map of all scans
//                    before, then it joins the map (Huang et al. 2021, IV-B)
//
// The map keeps one point for each voxel of `downsample_m`, with the normal and covariance that
// its own scan gave it, and is cropped to the reach of the scan that is matched.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "core/map/voxel_key.h"
#include "frontend/pairwise/pairwise_registration.h"

namespace lamina {

struct PairwiseSequenceResult {
  bool good = false;
  std::string reason;      // of a failure; names the scans
  std::vector<SE3> poses;  // T_world_scan, scan 0 at the identity; as far as it went
};

// Told after each scan.
using PairwiseProgress = std::function<void()>;

// Downsampled and prepared clouds. A scan with fewer than options.min_points points left is named
// in *fault, and nothing is returned.
std::vector<PairwiseCloud> PrepareClouds(const PairwiseMethod& method,
                                         const PairwiseOptions& options,
                                         const std::vector<std::vector<Eigen::Vector3f>>& scans,
                                         std::string* fault);

// `initial` gives each motion's initial guess: one pose for each scan, or empty for a method that
// needs none. A match in which too few points meet (min_overlap) is a failure.
PairwiseSequenceResult FrameToFrame(const PairwiseMethod& method, const PairwiseOptions& options,
                                    const std::vector<PairwiseCloud>& clouds,
                                    const std::vector<SE3>& initial,
                                    const PairwiseProgress& progress);

// `frame_to_frame` is what the function of that name found: the first of the two matches.
PairwiseSequenceResult FrameToMap(const PairwiseMethod& method, const PairwiseOptions& options,
                                  const std::vector<PairwiseCloud>& clouds,
                                  const PairwiseSequenceResult& frame_to_frame,
                                  const PairwiseProgress& progress);

// The map, world frame. Not thread-safe.
class PairwiseMap {
 public:
  explicit PairwiseMap(double voxel_m) : inverse_voxel_(1.0 / voxel_m) {}
  void Add(const PairwiseCloud& cloud, const SE3& T_world_cloud);
  // What lies within the radius of a place.
  PairwiseCloud Around(const Eigen::Vector3d& place, double radius_m) const;

 private:
  double inverse_voxel_;
  VoxelIndex taken_;
  PairwiseCloud all_;
};

}  // namespace lamina
