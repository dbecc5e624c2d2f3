// What speaks for and against a pose of a sensor in a place of the map, beside planes that agree
// (submap_registration.h): where much is alike, such as rooms of one size or both ends of one, what
// differs is little, and it is what one has and the other has not.
//
//     met     share of what the query has standing where the place has anything within half a leaf
//     gone    share of what stands in the place, and should show, through which keyframes saw:
//             in its direction all that they saw is farther. What is hidden or beside their view
//             says nothing
#pragma once

#include <Eigen/Core>
#include <vector>

#include "backend/submaps/final_keyframe.h"
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
};

// Ranges that keyframes saw, by direction. Immutable; thread-safe.
class SightLines {
 public:
  // Of some of the keyframes; the result lies in the frame of their poses.
  SightLines(const std::vector<FinalKeyframe>& keyframes, double leaf_size_m);

  struct Seen {
    int there = 0, gone = 0;  // points that show, and that should
    double GoneShare() const {
      return gone > 0 ? static_cast<double>(gone) / static_cast<double>(there + gone) : 0.0;
    }
  };
  Seen Look(const std::vector<Eigen::Vector3f>& points, const SE3& T_own_points) const;

  static constexpr int kAzimuths = 144, kElevations = 72;

 private:
  struct Image {
    SE3 T_lidar_own;
    std::vector<float> nearest_m;  // infinity: nothing was seen there
  };
  void Splat(const Eigen::Vector3d& p, Image* image) const;

  double leaf_size_m_;
  std::vector<Image> images_;
};

}  // namespace lamina
