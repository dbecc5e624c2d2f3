// The poses of the first scans of a piece, found again once others show what they saw.
//
// The second scan is matched to the first one while nothing is known of the motion: if that match
// is wrong, all later scans agree with one another, and the first one is displaced, or the first
// few if the sensor turns at once. Their own clusters hold them there, so each is matched to the
// map of those after it alone, from the last of them back, and searched for as in odometry where it
// fits badly.
//
// Private to backend/pieces.
#pragma once

#include <deque>
#include <vector>

#include "backend/window/sliding_window.h"
#include "core/geometry/se3.h"
#include "core/map/voxel_map.h"
#include "frontend/odometry/odometry_options.h"

namespace lamina {

// T_world_lidar of frames[0] and of those after it that are to move; empty where none clearly lies
// elsewhere than it has. `usual_inliers`: the share of a scan that lies on planes
// (MatchResult::inlier_share).
std::vector<SE3> FirstPosesByOthers(const std::deque<WindowFrame>& frames, double usual_inliers,
                                    const OdometryOptions& options,
                                    const VoxelMapOptions& map_options);

}  // namespace lamina
