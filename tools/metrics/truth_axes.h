// A true trajectory that is of another sensor, turned against the LiDAR, such as the camera of
// KITTI odometry. Alignment hides that from the positions, but not from relative poses.
//
// With steps a_i = t(estimate_i^-1 estimate_i+1) and b_i = t(truth_i^-1 truth_i+1), each in the
// sensor's own axes, the truth is of other axes if one rotation R explains nearly all of what lies
// between them (Kabsch 1976):
//
//     sum |b_i - R a_i|^2  <<  sum |b_i - a_i|^2
#pragma once

#include <string>

#include "tools/metrics/match.h"

namespace lamina {

// Says what axes the truth has and what to do, or nothing if they are the estimate's.
std::string DescribeOtherAxes(const ComparedTrajectory& compared);

}  // namespace lamina
