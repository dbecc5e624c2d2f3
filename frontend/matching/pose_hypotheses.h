// Hypotheses of a search for a scan's pose: turns and offsets about a prediction, as far as it
// leaves them open.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/geometry/se3.h"
#include "frontend/matching/pose_search_options.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {

struct PoseHypotheses {
  // As close together as matching reaches: the best by score are refined.
  std::vector<SE3> dense;
  // Too far apart for a score to tell which are near a minimum: PoseSearch::Best brings each to one
  // first, on a part of the clusters.
  std::vector<SE3> coarse;
  // Direction in which they are spread, a unit vector in the world.
  Eigen::Vector3d way = Eigen::Vector3d::Zero();

  // The hypotheses if no motion is known yet, and if the prediction continues one: as far as it
  // leaves open, along the way no farther than max_way_m.
  static PoseHypotheses Starting(const PoseSearchOptions& options, const PosePrediction& prediction,
                                 const SE3& T_world_last);
  static PoseHypotheses GoingOn(const PoseSearchOptions& options, const PosePrediction& prediction,
                                const SE3& T_world_last);

  bool empty() const { return dense.empty() && coarse.empty(); }
};

// Turns of the sensor about each of these poses.
std::vector<SE3> TurnsAbout(const PoseSearchOptions& options, const std::vector<SE3>& centres);
// The same about one axis at a time, in half of the steps.
std::vector<SE3> TurnsAboutAxes(const PoseSearchOptions& options, const SE3& centre);
// Turns about the sensor's z axis, all round, at each of these poses and some way beside them.
// Coarse.
std::vector<SE3> AllRound(const std::vector<SE3>& centres);
// Offsets along x and y of the sensor.
std::vector<SE3> OffsetsAbout(const PoseSearchOptions& options, const SE3& centre);

}  // namespace lamina
