// Which way is up in a submap, from its planes alone.
//
// Floors, roads and ceilings share a normal, and walls, trunks and poles stand upright on them: up
// is the direction n, near the one expected, that most leaves' normals m are either along or
// across,
//
//     max_n  sum_m  [|n . m| > cos 8 deg] + 1/2 [|n . m| < sin 8 deg],
//
// and then the mean of those along it. A hand-held sensor's frame is brought level by it.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <vector>

#include "backend/submaps/submap.h"

namespace lamina {

// A leaf of a submap that is planar by itself.
struct LeafPlane {
  Eigen::Vector3f mean;    // submap frame
  Eigen::Vector3f normal;  // unit, its sign means nothing
  float variance = 0.0F;   // m^2, the squared thickness
  std::size_t leaf = 0;    // its place in Submap::leaves
};

// Planes within 20 deg of level are floors, roads, ceilings.
inline bool LiesFlat(const LeafPlane& plane, const Eigen::Vector3d& up) {
  return std::abs(plane.normal.dot(up.cast<float>())) > 0.94F;
}

// Means of the leaves that do not lie flat, in the order of the leaves. `planes`: LeafPlanes of the
// same submap.
std::vector<Eigen::Vector3f> UprightLeaves(const Submap& submap,
                                           const std::vector<LeafPlane>& planes,
                                           const Eigen::Vector3d& up);

// What counts as planar: enough points, thin, and not a line.
std::vector<LeafPlane> LeafPlanes(const Submap& submap);

// Unit vector in the frame of the planes, at most `within_deg` from the expected one; that one
// where planes say nothing.
Eigen::Vector3d UpOfPlanes(const std::vector<LeafPlane>& planes, const Eigen::Vector3d& expected,
                           double within_deg);

}  // namespace lamina
