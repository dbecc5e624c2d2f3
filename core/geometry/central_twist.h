// Velocities from a trajectory.
#pragma once

#include <cstddef>

#include "core/geometry/scan.h"

namespace lamina {

// Body twist [w; v] (rad/s, m/s) at pose i: the mean of the motions from the pose before and to the
// pose after,
//
//     xi = 1/2 (log(T_{i-1}^-1 T_i) / dt + log(T_i^-1 T_{i+1}) / dt)
//
// which is the velocity at its stamp; at the ends, and where stamps do not increase or lie more
// than max_gap_s apart, the one that exists. False, and *twist untouched, if there is none.
bool CentralTwist(const Trajectory& poses, std::size_t i, double max_gap_s, Vector6d* twist);

}  // namespace lamina
