// What speaks for and against a pose of a sensor in a place of the map, beside planes that agree
// (submap_registration.h): where much is alike, such as rooms of one size or both ends of one, what
// differs is little, and it is what one has and the other has not.
//
//     met     share of what the query has standing where the place has anything within half a leaf
//     gone    share of what stands in the place, and should show, through which keyframes saw
//             (backend/submaps/sight_lines.h)
#pragma once

#include <Eigen/Core>
#include <vector>

#include "backend/submaps/submap.h"
#include "core/geometry/se3.h"
#include "core/map/voxel_key.h"

namespace lamina {

// The occupied leaves of a place. Immutable; thread-safe.
class OccupiedLeaves {
 public:
  explicit OccupiedLeaves(const Submap& place);

  // Share of these points, taken from the query to the place, beside which there is a leaf.
  double Met(const std::vector<Eigen::Vector3f>& points, const SE3& T_place_query) const;

 private:
  double leaf_size_m_;
  VoxelIndex index_;
  VoxelIndex blocks_;  // of 8 leaves each, in which it may be found that there is a leaf beside
};

}  // namespace lamina
