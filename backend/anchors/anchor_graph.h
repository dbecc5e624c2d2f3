// Anchors of submaps from odometry and loops, some of which may be wrong.
//
//     min_T  sum_odometry |r_e|^2 + sum_kept loops |r_e|^2,   r_e of relative_pose_residual.h
//
// Which loops are kept is decided by joint compatibility. From odometry alone, in rounds: a loop's
// innovation (what it says against the prediction, by the covariances of both) must pass a gate;
// of those that pass, the quarter whose prediction is surest comes in, and the graph is solved
// anew. A loop that is in and would not pass if it were left out goes. So a wrong loop meets a
// prediction that the right ones have made sharp; one that bends a short piece of odometry is found
// as well, although it fits. Solved by Ceres. The first pose of each connected part is held.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/geometry/se3.h"
#include "core/options/options.h"

namespace lamina {

struct AnchorEdge {
  std::size_t from = 0, to = 0;
  SE3 T_from_to;
  // Of [rotation; translation] of T_from_to, both in the frame of `to` (rad, m).
  Matrix6d information = Matrix6d::Identity();
  // W J, with W'W = information, which may be singular.
  Matrix6d SquareRootTimes(const Matrix6d& J) const;
};

struct AnchorGraph {
  std::vector<SE3> poses;  // T_world_submap, the start
  std::vector<AnchorEdge> odometry, loops;
  // Of the first loops: kept by an earlier solve, where this one begins.
  std::vector<bool> kept_before;
  // Poses that stay where they are. A part of the graph without one is held at its first pose.
  std::vector<std::size_t> fixed;
};

struct AnchorGraphOptions {
  int max_iterations = 100;
  // A loop whose innovation is greater, in standard deviations of its six numbers together, is
  // wrong.
  double gate_sigmas = 4.7;

  void Visit(OptionVisitor& v);
};

struct AnchorGraphResult {
  bool good = false;   // if not, poses and `kept` are those of before
  std::string reason;  // of a failure
  std::vector<SE3> poses;
  std::vector<bool> kept;    // of the loops
  double cost_before = 0.0;  // sum of |r_e|^2 over all edges, at the start
  double cost = 0.0;         // over odometry and the loops kept
  int iterations = 0;
};

// Of loops that are not kept: the others contradict them, or the solve failed.
std::string WhyLeftOut(const AnchorGraphResult& result);

// Pure function; deterministic. Throws std::out_of_range for an edge of a pose that there is not.
AnchorGraphResult SolveAnchorGraph(const AnchorGraph& graph, const AnchorGraphOptions& options);

// |r_e|^2 at these poses.
double SquaredResidual(const AnchorEdge& edge, const std::vector<SE3>& poses);

}  // namespace lamina
