// From the middle of a sweep, at which scans are mapped, to the scan's stamp, at which poses are
// wanted.
//
// Private to backend/pieces.
#pragma once

#include "core/geometry/scan.h"
#include "core/geometry/sweep_motion.h"
#include "frontend/odometry/odometry_frame.h"

namespace lamina {

// The pose at the stamp, `middle_ns` before the middle of the sweep, relative to the one there. A
// stamp far from its sweep is reached by steady motion.
SE3 AtStamp(const SweepMotion& sweep, StampNs middle_ns);

// A frame of the middle of a sweep becomes one of the scan's stamp. The covariance keeps what is
// unknown of the pose in the middle; the way between is known far better than that.
void MoveToStamp(StampNs middle_ns, OdometryFrame* frame);

}  // namespace lamina
