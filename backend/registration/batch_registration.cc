#include "backend/registration/batch_registration.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <new>
#include <sstream>

#include "backend/bundle/uncertainty/pose_covariance.h"
#include "backend/registration/batch_cast.h"
#include "backend/registration/frame_links.h"
#include "backend/registration/put_back.h"
#include "core/base/angle.h"
#include "core/base/parallel.h"
#include "core/base/stopwatch.h"
#include "frontend/scan/scan_clusters.h"

namespace lamina {
namespace {

using Status = RegistrationResult::Status;

// The frames with their clusters merged to voxels of this size; poses are left out.
std::vector<BatchFrame> Merged(const std::vector<BatchFrame>& frames, double leaf_size_m) {
  std::vector<BatchFrame> merged(frames.size());
  ParallelChunks(frames.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      std::vector<std::size_t> group_of;
      merged[k].stamp_ns = frames[k].stamp_ns;
      merged[k].clusters = MergeClusters(frames[k].clusters.Unpacked(), leaf_size_m, &group_of);
      if (frames[k].points.empty()) continue;
      merged[k].points.resize(merged[k].clusters.size());
      for (std::size_t i = 0; i < group_of.size(); ++i) {
        const std::vector<TimedPoint>& from = frames[k].points[i];
        std::vector<TimedPoint>& to = merged[k].points[group_of[i]];
        to.insert(to.end(), from.begin(), from.end());
      }
    }
  });
  return merged;
}

// Reason to refuse the problem; empty if there is something to solve.
std::string Refusal(const BundleProblem& problem, const Observability& observability,
                    const BundleAdjusterOptions& options) {
  if (problem.planes.size() < static_cast<std::size_t>(options.min_planes)) {
    return std::to_string(problem.planes.size()) +
           " planes are seen by two frames or more, at least " +
           std::to_string(options.min_planes) + " are wanted";
  }
  if (observability.free_frames.empty()) return "no frame shares enough with others to be moved";
  return "";
}

// Beyond this a turn of frames against each other leaves nothing of their associations.
constexpr double kMostTurnRad = 0.5;
// A chain may swing as a whole while no link of it turns by more.
constexpr double kMostSwingRad = 0.1;

// Frames that a solve has carried farther than its associations can be good for.
std::vector<int> FramesThatLeapt(const std::vector<SE3>& before, const std::vector<SE3>& after,
                                 double root_size_m) {
  std::vector<int> leapt;
  for (std::size_t k = 0; k < before.size(); ++k) {
    if ((after[k].t - before[k].t).norm() > root_size_m ||
        RotationAngle(before[k], after[k]) > kMostTurnRad) {
      leapt.push_back(static_cast<int>(k));
    }
  }
  return leapt;
}

// Root mean square over the frames: single ones may go back and forth with their associations.
bool MovedLess(const std::vector<SE3>& a, const std::vector<SE3>& b, double rotation_rad,
               double translation_m) {
  double rotation2 = 0.0, translation2 = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    rotation2 += std::pow(RotationAngle(a[k], b[k]), 2);
    translation2 += (a[k].t - b[k].t).squaredNorm();
  }
  const auto n = static_cast<double>(a.size());
  return rotation2 <= n * rotation_rad * rotation_rad &&
         translation2 <= n * translation_m * translation_m;
}

// A long chain swings at its end when its links hardly move: if these move far less, that is
// enough.
bool Settled(const std::vector<SE3>& before, const std::vector<SE3>& after, const FrameLinks& links,
             const RegistrationOptions& options) {
  constexpr double kBetween = 0.1;
  const double rad = Radians(options.min_rotation_change_deg);
  const double m = options.min_translation_change_m;
  const FrameLinks::Motion between = links.Between(before, after);
  return MovedLess(before, after, rad, m) ||
         (between.rad <= kBetween * rad && between.m <= kBetween * m);
}

// Finds what the problem does not determine, and holds it. False if there is nothing to solve: then
// *result says why.
bool HoldOpen(const std::vector<BatchFrame>& frames, const RegistrationOptions& options,
              Slides slides, BundleProblem* problem, RegistrationResult* result) {
  const Observability observability = FindObservability(*problem, options.observability, slides);
  result->faults = observability.faults;
  result->reason = Refusal(*problem, observability, options.solver);
  if (!result->reason.empty()) {
    result->status = Status::kIllPosed;
    return false;
  }
  PutSlidesBack(frames, result->faults, &problem->poses);
  problem->holds = observability.holds;
  problem->hold_first_pose = false;
  return true;
}

void AddCovariances(const BundleProblem& problem, RegistrationResult* result) {
  constexpr double kOpenVariance = 1e6;
  try {
    result->covariances =
        PoseCovariances(problem, result->poses, kOpenVariance, &result->covariance_failure);
    for (const BundleFault& fault : result->faults) {
      for (std::size_t i = 0; i < fault.motion.size() && !result->covariances.empty(); ++i) {
        if (fault.group[i] == fault.frame) continue;  // held: it has its share
        Matrix6d& covariance = result->covariances[static_cast<std::size_t>(fault.group[i])];
        covariance += kOpenVariance * fault.motion[i] * fault.motion[i].transpose();
      }
    }
  } catch (const std::bad_alloc&) {
    result->covariance_failure = "there is not enough memory for those of " +
                                 std::to_string(result->poses.size()) + " poses";
  }
}

}  // namespace

const char* ToString(RegistrationResult::Status status) {
  switch (status) {
    case Status::kConverged:
      return "converged";
    case Status::kRoundLimit:
      return "round_limit";
    case Status::kPartial:
      return "partial";
    case Status::kNoBetter:
      return "no_better";
    case Status::kIllPosed:
      return "ill_posed";
    case Status::kFailed:
      return "failed";
    case Status::kInterrupted:
      return "interrupted";
  }
  return "unknown";
}

void RegistrationOptions::Visit(OptionVisitor& v) {
  v.Integer("rounds", &rounds, 1, 1000);
  v.Number("coarse_root_size_m", &coarse_root_size_m, 0.0, 100.0);
  v.Number("min_rotation_change_deg", &min_rotation_change_deg, 0.0, 180.0);
  v.Number("min_translation_change_m", &min_translation_change_m, 0.0, 100.0);
  v.Group("solver", &solver);
  v.Group("observability", &observability);
}

BatchRegistration::BatchRegistration(const RegistrationOptions& options, const VoxelMapOptions& map,
                                     const SlidingWindowOptions& weights,
                                     const Formulation& formulation)
    : options_(options), map_(map), weights_(weights), formulation_(formulation) {
  CheckOptions(options, "registration");
  CheckOptions(map, "map");
  CheckOptions(weights, "backend.window");
}

double BatchRegistration::RootSize(int round) const {
  if (options_.coarse_root_size_m <= map_.root_size_m || options_.rounds < 2) {
    return map_.root_size_m;
  }
  // The last two rounds have the final size, so that convergence can be seen there.
  const double last = std::max(1, options_.rounds - 2);
  const double left = std::max(0.0, 1.0 - round / last);
  return map_.root_size_m * std::pow(options_.coarse_root_size_m / map_.root_size_m, left);
}

int BatchRegistration::MergeFactor(int round) const {
  return 1 << std::lround(std::log2(RootSize(round) / map_.root_size_m));
}

BundleProblem BatchRegistration::CastRound(const std::vector<BatchFrame>& frames,
                                           const std::vector<SE3>& poses,
                                           double root_size_m) const {
  VoxelMapOptions map = map_;
  map.root_size_m = root_size_m;
  // Poor poses make planes thick: what passes for one grows with the voxel.
  map.max_thickness_m *= map.root_size_m / map_.root_size_m;
  return BatchCast(frames, poses, WithinRange(map), weights_).Problem(formulation_.needs_points);
}

BundleResult BatchRegistration::SolveRound(const RegistrationCallbacks& callbacks,
                                           const FrameLinks& links, BundleProblem* problem,
                                           bool* swings, RoundReport* report,
                                           std::vector<BundleFault>* faults) const {
  const BundleObserver observer = [&](const BundleStep& step, const std::vector<SE3>&) {
    if (callbacks.on_step) callbacks.on_step(*report, step);
  };
  report->planes = problem->planes.size();
  report->observations = problem->observations.size();
  BundleResult solved = AdjustBundle(*problem, options_.solver, formulation_, observer);
  *swings = *swings && solved.usable() &&
            !links.AnyFarther(solved.poses, report->root_size_m, kMostSwingRad);
  std::vector<int> leapt;
  if (!*swings) leapt = FramesThatLeapt(problem->poses, solved.poses, report->root_size_m);
  for (const int frame : leapt) {
    for (int i = 0; i < 6; ++i) problem->holds.push_back({frame, Vector6d::Unit(i)});
    BundleFault fault;
    fault.kind = BundleFault::Kind::kLeapt;
    fault.frame = frame;
    faults->push_back(fault);
  }
  if (!leapt.empty()) {
    report->leapt = true;
    solved = AdjustBundle(*problem, options_.solver, formulation_, observer);
  }
  report->initial_cost = solved.initial_cost;
  report->final_cost = solved.final_cost;
  report->iterations = solved.iterations;
  report->solve_ms = solved.solve_ms;
  return solved;
}

double BatchRegistration::MisfitAt(const std::vector<BatchFrame>& frames,
                                   const std::vector<SE3>& poses) const {
  const OtherVoxels other(map_, poses);
  return BatchCast(frames, other.poses, other.map, weights_).Misfit();
}

void BatchRegistration::JudgeAgainstStart(const std::vector<BatchFrame>& frames,
                                          RegistrationResult* result) const {
  // What has not converged is no better for a little: of poor poses the distances from planes are
  // mostly as large as they count, before and after.
  constexpr double kSame = 1.01, kClearlyBetter = 0.9;
  if (result->rounds.empty()) return;
  std::vector<SE3> initial;
  for (const BatchFrame& frame : frames) initial.push_back(frame.T_world_lidar);
  result->initial_misfit_m = MisfitAt(frames, initial);
  result->final_misfit_m = MisfitAt(frames, result->poses);
  const double most = result->status == Status::kConverged ? kSame : kClearlyBetter;
  if (result->final_misfit_m <= most * result->initial_misfit_m) return;
  result->poses = initial;
  if (!result->reason.empty()) return;  // refused, or failed, after some rounds
  result->status = Status::kNoBetter;
  std::ostringstream reason;
  reason << std::setprecision(3) << "the map of the result is "
         << (result->final_misfit_m > result->initial_misfit_m ? "worse" : "hardly better")
         << " than that of the initial poses: " << 1e3 * result->final_misfit_m << " against "
         << 1e3 * result->initial_misfit_m << " mm from its planes";
  result->reason = reason.str();
}

RegistrationResult BatchRegistration::Run(const std::vector<BatchFrame>& frames,
                                          const RegistrationCallbacks& callbacks,
                                          const std::atomic<bool>* stop) const {
  BundleProblem problem;
  RegistrationResult result = Solve(frames, callbacks, stop, &problem);
  JudgeAgainstStart(frames, &result);
  if (callbacks.on_poses) callbacks.on_poses(result);
  if (result.reason.empty() && result.covariance_failure.empty()) AddCovariances(problem, &result);
  return result;
}

RegistrationResult BatchRegistration::Solve(const std::vector<BatchFrame>& frames,
                                            const RegistrationCallbacks& callbacks,
                                            const std::atomic<bool>* stop,
                                            BundleProblem* problem) const {
  RegistrationResult result;
  for (const BatchFrame& frame : frames) result.poses.push_back(frame.T_world_lidar);
  result.status = Status::kRoundLimit;
  std::vector<BatchFrame> merged;
  FrameLinks links;
  bool swings = true;  // chains may, until a link has broken
  for (int round = 0; round < options_.rounds && result.status == Status::kRoundLimit; ++round) {
    Stopwatch watch;
    RoundReport report;
    report.round = round;
    report.root_size_m = RootSize(round);
    const int factor = MergeFactor(round);
    if (factor == 1) {
      merged.clear();
    } else if (round == 0 || factor != MergeFactor(round - 1)) {
      merged = Merged(frames, factor * map_.LeafSize());
    }
    *problem = CastRound(factor > 1 ? merged : frames, result.poses, report.root_size_m);
    links.Apply(problem);
    links.Add(*problem);
    // Poor poses part planes that belong together; coarse rounds are there to join them.
    const bool coarse = report.root_size_m > map_.root_size_m;
    const Slides slides = coarse ? Slides::kFree : Slides::kHeld;
    if (!HoldOpen(frames, options_, slides, problem, &result)) return result;
    report.build_ms = watch.LapMilliseconds();
    BundleResult solved = SolveRound(callbacks, links, problem, &swings, &report, &result.faults);
    if (links.CutFarther(solved.poses, RootSize(0), kMostTurnRad) > 0) {
      report.leapt = true;
      links.Apply(problem);
      if (!HoldOpen(frames, options_, slides, problem, &result)) return result;
      solved = SolveRound(callbacks, links, problem, &swings, &report, &result.faults);
    }
    result.rounds.push_back(report);
    if (callbacks.on_round) callbacks.on_round(report);
    if (!solved.usable()) {
      result.status = Status::kFailed;
      result.reason = "the solver failed in round " + std::to_string(round);
      return result;
    }
    const bool settled = Settled(result.poses, solved.poses, links, options_);
    result.poses = solved.poses;
    if (settled && !coarse) {
      result.status = Status::kConverged;
    } else if (stop != nullptr && stop->load()) {
      result.status = Status::kInterrupted;
    }
  }
  if (result.status == Status::kRoundLimit)
    result.covariance_failure = "poses had not settled when the rounds ended (registration.rounds)";
  if (!result.faults.empty() && result.status != Status::kInterrupted) {
    PutPartsBack(frames, result.faults, &result.poses);
    result.status = Status::kPartial;
  }
  return result;
}

void BatchRegistration::VisitSurfels(const std::vector<BatchFrame>& frames,
                                     const std::vector<SE3>& poses, int min_frames,
                                     const std::function<void(const Surfel&)>& visit) const {
  BatchCast(frames, poses, map_, weights_).map().ForEachSurface(min_frames, visit);
}

}  // namespace lamina
