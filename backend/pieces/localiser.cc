#include "backend/pieces/localiser.h"

#include <cmath>
#include <utility>

#include "backend/pieces/sweep_stamp.h"
#include "core/base/angle.h"
#include "frontend/scan/scan_clusters.h"

namespace lamina {
namespace {

// How far a sensor whose speed is not known may have come from the middle of its sweep to the
// stamp, and by how much a sweep that is not deskewed may fit the map beside its middle.
void LeaveSpeedOpen(const MotionOptions& motion, const MapperScan& scan, MatchResult* match) {
  constexpr double kOfSweep = 0.1;
  const double open_s = std::abs(kSecondsPerNs * static_cast<double>(scan.middle_ns)) +
                        kOfSweep * SweepLength(*scan.clusters);
  const double turn_rad = open_s * Radians(motion.start_turn_sigma_deg_s);
  const double way_m = open_s * motion.start_speed_sigma_m_s;
  match->covariance.diagonal().head<3>().array() += turn_rad * turn_rad;
  match->covariance.diagonal().tail<3>().array() += way_m * way_m;
  match->worst_sigma_m = std::hypot(match->worst_sigma_m, way_m);
}

}  // namespace

Localiser::Localiser(const MapperOptions& options, VoxelMap* map, std::int64_t piece)
    : map_(map), piece_(piece), tracker_(options), motion_(options.frontend.motion) {}

void Localiser::Start(const SE3& T_world_lidar) {
  may_restart_ = false;
  tracker_.odometry().StartAt(T_world_lidar);
}

void Localiser::Start(const Trajectory& last) { tracker_.StartAfter(last); }

RegisteredScan Localiser::Process(const MapperScan& scan, bool may_restart) {
  map_->SelectPiece(piece_);
  RegisteredScan result;
  OdometryFrame& frame = result.odometry;
  frame = tracker_.Register(scan.stamp_ns + scan.middle_ns, scan.stamp_made_up, *scan.clusters,
                            map_, /*map_is_older=*/true);
  if (frame.status == OdometryFrame::Status::kLost) {
    tracker_.Lose(frame, *scan.clusters);
    if (may_restart && may_restart_ && tracker_.MayRestart(/*matched=*/true))
      result.ends = PieceEnd::kUnconnected;
  } else {
    // From the second scan on the motion since the one before tells the speed.
    const bool way_known = tracker_.odometry().motion().Gap(frame.stamp_ns) > 0.0;
    if (!way_known) LeaveSpeedOpen(motion_, scan, &frame.match);
    tracker_.Accept(frame);
  }
  map_->Refresh();  // what was brought back
  MoveToStamp(scan.middle_ns, &frame);
  if (result.ends == PieceEnd::kNone) final_.push_back({scan.stamp_ns, frame.T_world_lidar});
  return result;
}

Trajectory Localiser::TakeFinal() { return std::exchange(final_, {}); }

void Localiser::Archive(StateArchive& a) { a(&tracker_, &may_restart_, &final_); }

}  // namespace lamina
