// Rounds of association and adjustment, as bundle adjustment of submaps (submap_bundle.h) and of
// keyframes (backend/tiles/keyframe_bundle.h) has them: planes are found at the present poses,
// poses are adjusted to them, until they move no more.
#pragma once

#include <vector>

#include "backend/bundle/solver/adjuster.h"
#include "core/geometry/se3.h"

namespace lamina {

// Planes may be so much thicker in the first round: that is what poses may be off by.
inline constexpr double kFirstRoundThickness = 2.0;
inline constexpr BundleAdjusterOptions kRoundSolver = {20, 1e-6, 20};

// By what a round moves poses.
struct PoseMoves {
  double largest_m = 0.0, largest_rad = 0.0;
  double rms_m = 0.0, rms_rad = 0.0;
};
// As many of either; zero where there are none.
PoseMoves MovesBetween(const std::vector<SE3>& from, const std::vector<SE3>& to);

}  // namespace lamina
