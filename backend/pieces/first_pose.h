// The pose of the first scan of a piece, found again once others show what it saw.
//
// The first scan is what the second is matched to, when nothing is known of how the sensor moves:
// if the two are brought together wrongly, all that follows agrees with itself and with the second
// scan, and the first lies aside. Its own clusters hold it there, so it is matched to the map of
// the others alone, searched for as in odometry where it fits badly.
//
// Private to backend/pieces.
#pragma once

#include <deque>
#include <optional>

#include "backend/window/sliding_window.h"
#include "core/geometry/se3.h"
#include "core/map/voxel_map.h"
#include "frontend/odometry/odometry.h"

namespace lamina {

// T_world_lidar of frames[0] by all others; none where that is not clearly another than it has.
// `usual_inliers`: the share of a scan that lies on planes (MatchResult::inlier_share).
std::optional<SE3> FirstPoseByOthers(const std::deque<WindowFrame>& frames, double usual_inliers,
                                     const OdometryOptions& options,
                                     const VoxelMapOptions& map_options);

}  // namespace lamina
