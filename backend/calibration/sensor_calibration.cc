#include "backend/calibration/sensor_calibration.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "backend/bundle/plane_geometry.h"
#include "backend/bundle/uncertainty/observability.h"
#include "backend/calibration/calibration_drive.h"
#include "backend/calibration/intrinsics_estimate.h"
#include "core/base/angle.h"

namespace lamina {
namespace {

const Intrinsics kSmallStep(2e-4 * kDegree, 5e-5);

// The bundle problem of a segment with its clusters moved by the offsets.
BundleProblem Cast(const CalibrationSegment& segment, const Intrinsics& offsets,
                   const VoxelMapOptions& map_options, const SlidingWindowOptions& weights) {
  VoxelMap map(map_options);
  SlidingWindow window(weights, &map);
  for (const CalibrationFrame& from : segment) {
    WindowFrame frame;
    frame.id = static_cast<std::int64_t>(window.frames().size());
    frame.stamp_ns = from.stamp_ns;
    frame.T_world_lidar = from.T_world_lidar;
    frame.sweep = from.sweep;
    frame.measured = Corrected(from.measured, offsets);
    window.Push(std::move(frame));
  }
  map.Refresh();
  BundleProblem problem = window.BuildProblem();
  problem.priors.clear();  // planes alone are to decide
  problem.holds = FindObservability(problem, ObservabilityOptions()).holds;
  problem.hold_first_pose = false;
  return problem;
}

struct SegmentSystem {
  bool usable = false;
  IntrinsicsSystem system;
  std::size_t planes = 0;
  double points = 0.0, residual2 = 0.0;  // sum of the squared distances to the planes
};

CalibrationRound MakeRound(int number, const std::vector<SegmentSystem>& systems,
                           const Intrinsics& offsets, const Intrinsics& step) {
  CalibrationRound round;
  round.round = number;
  round.offsets = offsets;
  round.step = step;
  double points = 0.0, residual2 = 0.0;
  for (const SegmentSystem& s : systems) {
    round.planes += s.planes;
    points += s.points;
    residual2 += s.residual2;
  }
  round.thickness_m = std::sqrt(residual2 / std::max(points, 1.0));
  return round;
}

// At the segment's poses, which are adjusted first.
SegmentSystem Linearise(const BundleProblem& problem, const BundleAdjusterOptions& solver,
                        CalibrationSegment* segment) {
  SegmentSystem result;
  const BundleResult solved = AdjustBundle(problem, solver);
  if (!solved.usable()) return result;
  for (std::size_t k = 0; k < segment->size(); ++k) {
    (*segment)[k].T_world_lidar = solved.poses[k];
  }
  result.system = LineariseIntrinsics(problem, solved.poses);
  result.planes = problem.planes.size();
  for (const PlaneFrame& frame : MakePlaneFrames(problem, PoseMatrices(solved.poses))) {
    result.points += frame.count;
    result.residual2 += frame.count * frame.l(2);
  }
  result.usable = result.system.H.allFinite() && result.system.g.allFinite();
  return result;
}

IntrinsicsEstimate SumOf(const std::vector<SegmentSystem>& systems) {
  IntrinsicsEstimate totals;
  for (const SegmentSystem& s : systems) {
    if (s.usable) totals.Add(s.system);
  }
  return totals;
}

// Gives up the offset whose standard deviation is farthest beyond its limit. False if there is
// none.
bool DropUndetermined(const Intrinsics& sigma, const Intrinsics& limits,
                      CalibrationResult* result) {
  int worst = -1;
  for (int i = 0; i < 2; ++i) {
    if (!result->determined[static_cast<std::size_t>(i)]) continue;
    result->sigma(i) = sigma(i);
    if (sigma(i) <= limits(i)) continue;
    if (worst < 0 || sigma(i) / limits(i) > sigma(worst) / limits(worst)) worst = i;
  }
  if (worst < 0) return false;
  result->determined[static_cast<std::size_t>(worst)] = false;
  result->offsets(worst) = 0.0;
  return true;
}

}  // namespace

void CalibrationOptions::Visit(OptionVisitor& v) {
  v.Integer("segments", &segments, 1, 1000);
  v.Integer("segment_frames", &segment_frames, 3, 200);
  v.Number("frame_spacing_share", &frame_spacing_share, 0.0, 1.0);
  v.Integer("max_rounds", &max_rounds, 1, 1000);
  v.Integer("max_passes", &max_passes, 1, 100);
  v.Number("noise_floor_m", &noise_floor_m, 1e-4, 1.0);
  v.Number("max_elevation_sigma_deg", &max_elevation_sigma_deg, 1e-6, 10.0);
  v.Number("max_range_sigma_m", &max_range_sigma_m, 1e-6, 10.0);
  v.Group("solver", &solver);
}

std::vector<std::vector<std::size_t>> PickSegments(const Trajectory& poses,
                                                   const std::vector<bool>& usable,
                                                   double median_range_m,
                                                   const CalibrationOptions& options) {
  const double spacing_m = options.frame_spacing_share * median_range_m;
  std::vector<std::vector<std::size_t>> pieces(1);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!usable[i]) continue;
    std::vector<std::size_t>& piece = pieces.back();
    if (!piece.empty()) {
      const SE3& last = poses[piece.back()].T_world_lidar;
      const SE3& T = poses[i].T_world_lidar;
      if ((T.t - last.t).norm() < spacing_m && RotationAngle(last, T) < options.frame_spacing_share)
        continue;
    }
    piece.push_back(i);
    if (piece.size() == static_cast<std::size_t>(options.segment_frames)) pieces.emplace_back();
  }
  // A rest too short to be a segment joins the one before it.
  constexpr std::size_t kLeastFrames = 3;
  std::vector<std::size_t> rest = std::move(pieces.back());
  pieces.pop_back();
  const bool whole = rest.size() >= kLeastFrames &&
                     2 * rest.size() >= static_cast<std::size_t>(options.segment_frames);
  if (whole || pieces.empty()) {
    if (rest.size() >= kLeastFrames) pieces.push_back(std::move(rest));
  }
  const auto most = static_cast<std::size_t>(options.segments);
  if (pieces.size() <= most) return pieces;
  std::vector<std::vector<std::size_t>> spread;
  for (std::size_t s = 0; s < most; ++s)
    spread.push_back(std::move(pieces[s * pieces.size() / most]));
  return spread;
}

SensorCalibration::SensorCalibration(const CalibrationOptions& options, const VoxelMapOptions& map,
                                     const SlidingWindowOptions& weights)
    : options_(options), map_(map), weights_(weights) {
  CheckOptions(options, "calibration");
  CheckOptions(map, "map");
  CheckOptions(weights, "backend.window");
  map_.noise_floor_m = options.noise_floor_m;
}

CalibrationResult SensorCalibration::Run(
    std::vector<CalibrationSegment>* segments,
    const std::function<void(const CalibrationRound&)>& on_round,
    const std::atomic<bool>* stop) const {
  using Status = CalibrationResult::Status;
  CalibrationResult result;
  const Intrinsics limits(options_.max_elevation_sigma_deg * kDegree, options_.max_range_sigma_m);
  result.status = Status::kRoundLimit;
  result.determined = {true, true};
  for (int r = 0; r < options_.max_rounds; ++r) {
    if (stop != nullptr && stop->load()) {
      result.status = Status::kInterrupted;
      return result;
    }
    std::vector<SegmentSystem> systems;
    for (CalibrationSegment& s : *segments) {
      systems.push_back(Linearise(Cast(s, result.offsets, map_, weights_), options_.solver, &s));
    }
    const IntrinsicsEstimate totals = SumOf(systems);
    const Intrinsics step = totals.Step(result.determined, result.offsets);
    result.offsets += step;
    for (std::size_t s = 0; s < segments->size(); ++s) {
      if (!systems[s].usable) continue;
      const IntrinsicsSystem& system = systems[s].system;
      MovePoses(system.pose_step + system.pose_slope * step, &(*segments)[s]);
    }
    const Intrinsics sigma = totals.Sigma(result.determined);
    const bool settled =
        (step.cwiseAbs().array() <= kSmallStep.cwiseMax(0.02 * sigma).array()).all();
    result.rounds.push_back(MakeRound(r, systems, result.offsets, step));
    result.segments = totals.problems();
    if (on_round) on_round(result.rounds.back());
    // While steps are long, the segments' gradients say little of how well they agree.
    if (DropUndetermined(settled ? sigma : totals.FormalSigma(result.determined), limits,
                         &result)) {
      if (result.determined[0] || result.determined[1]) continue;
      result.status = Status::kNotDetermined;
      return result;
    }
    if (settled) {
      result.status = Status::kConverged;
      return result;
    }
  }
  return result;
}

}  // namespace lamina
