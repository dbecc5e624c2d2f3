#include "backend/session/scan_record.h"

#include <algorithm>

#include "core/geometry/degeneracy.h"

namespace lamina {
namespace {

// Along the direction that is known least: by planes alone, or, if that is more, by all that the
// pose may be wrong by. At most MatchResult::kUnknownSigmaM.
double WorstSigmaOf(const MatchResult& match) {
  return std::max(match.worst_sigma_m,
                  std::min(WorstSigmaM(match.covariance), MatchResult::kUnknownSigmaM));
}

}  // namespace

ScanRecord RecordOf(const MappedScan& report) {
  const MatchResult& match = report.odometry.match;
  ScanRecord s;
  s.scan = static_cast<std::int64_t>(report.index);
  s.stamp_ns = report.stamp_ns;
  s.recorded_stamp = !report.stamp_made_up;
  s.skipped = report.skipped;
  s.T_world_lidar = report.odometry.T_world_lidar;
  s.status = StatusName(report);
  s.detail = report.detail;
  s.piece = report.piece;
  s.keyframe = report.keyframe;
  s.searched = report.odometry.searched;
  s.points = static_cast<std::int64_t>(report.points);
  s.clusters = static_cast<std::int64_t>(report.clusters);
  s.matched = match.matched;
  s.iterations = match.iterations;
  s.unobservable_directions = match.degenerate;
  s.inlier_share = match.inlier_share;
  s.residual_m = match.residual_rms_m;
  s.worst_sigma_m = WorstSigmaOf(match);
  s.covariance = match.covariance;
  s.read_ms = report.read_ms;
  s.prepare_ms = report.prepare_ms;
  s.cluster_ms = report.cluster_ms;
  s.odometry_ms = report.odometry_ms;
  s.map_ms = report.map_ms;
  s.solve_ms = report.solve_ms;
  return s;
}

SessionSolve RecordOf(const SolveReport& report) {
  SessionSolve s;
  s.before_scan = static_cast<std::int64_t>(report.before_scan);
  s.frames = static_cast<std::int64_t>(report.frames);
  s.planes = static_cast<std::int64_t>(report.planes);
  s.observations = static_cast<std::int64_t>(report.observations);
  s.iterations = report.result.iterations;
  s.usable = report.result.usable() && !report.discarded;
  s.initial_cost = report.result.initial_cost;
  s.final_cost = report.result.final_cost;
  s.solve_ms = report.result.solve_ms;
  return s;
}

FinalPose PoseOf(const ScanRecord& scan) {
  return {static_cast<std::size_t>(scan.scan),
          {scan.stamp_ns, scan.T_world_lidar},
          scan.skipped,
          scan.piece};
}

FinalPose AsRecorded(const SessionDatabase& database, const FinalPose& pose) {
  if (!pose.skipped) return pose;
  FinalPose recorded = pose;
  const auto scan = static_cast<std::int64_t>(pose.scan);
  database.ForEach(scan, scan + 1, [&](const ScanRecord& row) {
    if (!row.skipped) recorded = PoseOf(row);
  });
  return recorded;
}

}  // namespace lamina
