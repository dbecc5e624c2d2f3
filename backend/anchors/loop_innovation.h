// How far each loop of an anchor graph is from what the rest of the graph says.
//
// Linearised at the present poses: with A = sum J'J over the edges that count, and J, r those of a
// loop, weighted by its information,
//
//     H = J A^-1 J',      d^2 = r' (I + H)^-1 r,      or r' (I - H)^-1 r of a loop that is in A.
//
// A^-1 is needed where two poses have an edge alone: selected_inverse.h, at the cost of one
// factorisation for all loops.
//
// Private to backend/anchors.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "core/geometry/se3.h"

namespace lamina {

// An edge at the present poses: its residual, and the derivative of that by each of its poses that
// is not held.
struct LinearEdge {
  struct End {
    int pose = -1;  // number among the poses that are not held
    Matrix6d J = Matrix6d::Zero();
  };
  std::array<End, 2> ends;
  Vector6d residual = Vector6d::Zero();
};

// What a loop says that is not in it: of one that counts, what it would say had it been left out.
struct Innovation {
  double square = 0.0;       // d^2: in its own sigmas and those of the prediction together
  double uncertainty = 0.0;  // log determinant of that covariance, in sigmas of the loop alone
};

// Of the edges from `first_loop` on; kept[i]: that loop i is in A, where all edges before it are.
std::vector<Innovation> LoopInnovations(const std::vector<LinearEdge>& edges,
                                        std::size_t first_loop, const std::vector<bool>& kept);

}  // namespace lamina
