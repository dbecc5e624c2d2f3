// Where a scan that is believed may be instead.
#include "frontend/odometry/odometry.h"

namespace lamina {

Vector6d Odometry::Elsewhere(const SearchedScan& scan, const PoseHypotheses& hypotheses,
                             const OdometryFrame& frame, bool searched) const {
  if (!options_.search.enabled) return Vector6d::Zero();
  const bool again = !lost_ && !elsewhere_.isZero();
  const bool open_start = scan.starting && (!motion_.stamps_recorded() ||
                                            motion_.Gap(frame.stamp_ns) > kMostFollowingGapS);
  if (!again && !searched && !open_start) return Vector6d::Zero();
  if (!again && !hypotheses.empty()) return search_.Elsewhere(scan, hypotheses, frame.match);
  // If the last pose is wrong, so is its motion: the scan is told from other places only if it is
  // from all that a start leaves open.
  const PosePrediction prediction = motion_.PredictAsAtStart(frame.stamp_ns);
  const SearchedScan open{scan.clusters, prediction, scan.map, /*starting=*/true};
  PoseHypotheses all =
      PoseHypotheses::Starting(options_.search, prediction, motion_.T_world_last());
  search_.Descend(open, &all);
  return search_.Elsewhere(open, all, frame.match);
}

}  // namespace lamina
