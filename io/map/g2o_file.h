// Pose graphs as g2o files (Kuemmerle et al. 2011), the exchange format of the field.
//
//     VERTEX_SE3:QUAT id x y z qx qy qz qw                          T_world_pose
//     EDGE_SE3:QUAT   from to x y z qx qy qz qw I11 I12 ... I66     T_from_to, information
//     FIX id ...                                                    held at its pose
//
// The information is the upper triangle, row by row, for the error of an edge,
//
//     e = [t; qx qy qz] of T_from_to^-1 T_world_from^-1 T_world_to.
//
// Here it is kept for [2 q; t], rotation first and in radians, so that cost = sum e' I e is that of
// the file. Vertices may stand in any order, after or before the edges that name them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/geometry/se3.h"

namespace lamina {

struct G2oEdge {
  std::size_t from = 0, to = 0;  // positions in G2oGraph::poses
  SE3 T_from_to;
  Matrix6d information = Matrix6d::Identity();  // [rotation; translation]
};

struct G2oGraph {
  std::vector<std::int64_t> ids;  // of the vertices, ascending
  std::vector<SE3> poses;
  std::vector<G2oEdge> edges;
  std::vector<std::size_t> fixed;
};

// Throws InputError, naming file, line and rule: numbers that are missing, too many or not finite,
// quaternions without length, information that is not positive semi-definite, ids that are given
// twice or not at all, lines of another kind (2D graphs among them), a file without a vertex.
G2oGraph ReadG2o(const std::string& path);

// Throws OutputError. What is written reads as the same graph, to the last bit of what the file's
// conventions allow.
void WriteG2o(const std::string& path, const G2oGraph& graph);

}  // namespace lamina
