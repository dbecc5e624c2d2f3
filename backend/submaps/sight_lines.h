// What keyframes saw past: of two maps of one place, what stands in one and should show in the
// other does show there.
//
//     gone    share of what stands in the other map, and should show, through which keyframes saw:
//             in its direction all that they saw is farther. What is hidden or beside their view
//             says nothing
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <limits>
#include <vector>

#include "backend/submaps/final_keyframe.h"
#include "backend/submaps/submap.h"
#include "core/geometry/se3.h"

namespace lamina {

// Ranges that keyframes saw, by direction. Immutable; thread-safe.
class SightLines {
 public:
  // Of nothing.
  SightLines() = default;
  // Of some of the keyframes, each of what it saw; the result lies in the frame of their poses.
  SightLines(const std::vector<FinalKeyframe>& keyframes, double leaf_size_m);
  // Of a submap and its leaves, from some of its keyframes: what is nearest hides what is behind
  // it, whichever keyframe saw either. The result lies in the frame of the submap.
  SightLines(const Submap& submap, const SubmapLeaves& leaves);

  struct Seen {
    int there = 0, gone = 0;  // points that show, and that should
    double GoneShare() const {
      return gone > 0 ? static_cast<double>(gone) / static_cast<double>(there + gone) : 0.0;
    }
    Seen operator+(const Seen& other) const { return {there + other.there, gone + other.gone}; }
  };
  Seen Look(const std::vector<Eigen::Vector3f>& points, const SE3& T_own_points) const;
  // At what rises above the sensor by so much alone: walls, poles and trees, no cars, no people.
  Seen LookAbove(const std::vector<Eigen::Vector3f>& points, const SE3& T_own_points,
                 const Eigen::Vector3d& up_own, double least_m) const;

 private:
  struct Image {
    SE3 T_lidar_own;
    std::vector<float> nearest_m;  // infinity: nothing was seen there
  };
  // Of what has these means, in the frame of the result.
  Image ImageOf(const SE3& T_own_lidar, const std::vector<Eigen::Vector3d>& means) const;
  void Splat(const Eigen::Vector3d& p_lidar, Image* image) const;
  float Nearest(const Image& image, const Eigen::Vector3d& p_lidar) const;
  Seen LookFrom(const Image& image, const std::vector<Eigen::Vector3f>& points,
                const SE3& T_own_points, const Eigen::Vector3d& up_own, double least_m) const;

  double leaf_size_m_ = 0.0, behind_m_ = 0.0;
  std::vector<Image> images_;
};

}  // namespace lamina
