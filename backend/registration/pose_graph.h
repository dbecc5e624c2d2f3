// Poses from relative poses, some of which may be wrong.
//
//     min_T  sum_e rho(|r_e|^2),   r_e = W_e [Log(dR_e); dt_e],   dT_e = Z_e^-1 T_from^-1 T_to
//
// Z_e is the measured T_from_to, W_e the inverse of its standard deviations, and rho the kernel of
// Geman and McClure, which lets wrong edges go. The start is the spanning tree of greatest total
// weight, so that edges with many inliers carry the first guess. Solved by Ceres; the first pose is
// held at the identity.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/geometry/se3.h"
#include "core/options/options.h"

namespace lamina {

struct PoseGraphEdge {
  std::size_t from = 0, to = 0;
  SE3 T_from_to;
  double weight = 1.0;  // how far it is to be trusted, e.g. a number of inliers
};

struct PoseGraphOptions {
  int max_iterations = 100;
  // Of an edge of the mean weight; those of others go with 1 / sqrt(weight).
  double rotation_sigma_deg = 0.5;
  double translation_sigma_m = 0.05;
  // Scale of the kernel, in standard deviations.
  double kernel_sigma = 3.0;

  void Visit(OptionVisitor& v);
};

struct PoseGraphResult {
  bool good = false;
  std::string reason;  // of a failure
  std::vector<SE3> poses;
  std::size_t rejected = 0;  // edges farther off than the kernel's scale
};

// T_world_k along the spanning tree of greatest weight; a pose that no edge leads to is named in
// the reason. Ties go to the earlier edge.
PoseGraphResult SpanningTreePoses(std::size_t poses, const std::vector<PoseGraphEdge>& edges);

// Pure function; deterministic. Throws std::out_of_range for an edge of a pose that there is not.
PoseGraphResult SolvePoseGraph(std::size_t poses, const std::vector<PoseGraphEdge>& edges,
                               const PoseGraphOptions& options);

}  // namespace lamina
