#include "tools/promises/judge.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "core/base/angle.h"
#include "tools/metrics/trajectory_metrics.h"

namespace lamina {
namespace {

bool IsJudged(const TrialFrame& frame) {
  return frame.status == "tracked" || frame.status == "first";
}

// The position, and points 1 m along the axes.
void AddPoints(const SE3& T_world_lidar, Trajectory* points) {
  for (int axis = -1; axis < 3; ++axis) {
    const Eigen::Vector3d p =
        axis < 0 ? Eigen::Vector3d::Zero() : Eigen::Vector3d(Eigen::Vector3d::Unit(axis));
    points->push_back({0, SE3(T_world_lidar.q, T_world_lidar * p)});
  }
}

// T with T * estimate ~ truth, over the judged frames of a piece.
SE3 FitPiece(const std::vector<TrialFrame>& frames, const std::vector<std::size_t>& judged) {
  Trajectory estimate, truth;
  for (const std::size_t i : judged) {
    AddPoints(frames[i].T_world_lidar, &estimate);
    AddPoints(frames[i].T_world_lidar_true, &truth);
  }
  return AlignTrajectories(estimate, truth, Alignment::kSe3);
}

// Over stretches of 100 m; 0 if there is none.
double DriftPercent(const std::vector<TrialFrame>& frames, const std::vector<std::size_t>& judged) {
  if (judged.size() < 2) return 0.0;
  Trajectory estimate, truth;
  for (const std::size_t i : judged) {
    estimate.push_back({frames[i].stamp_ns, frames[i].T_world_lidar});
    truth.push_back({frames[i].stamp_ns, frames[i].T_world_lidar_true});
  }
  const SegmentError error =
      CompareTrajectories(estimate, truth, Alignment::kFirst).kitti_segments.front();
  return error.segments > 0 ? error.translation_percent : 0.0;
}

std::string WhatIsBroken(const Verdict& verdict, const Promise& promise) {
  std::vector<std::string> broken;
  if (!(verdict.worst_m <= promise.within_m)) {
    broken.push_back(fmt::format("{:.3f} m off", verdict.worst_m));
  }
  if (!(verdict.drift_percent <= promise.drift_percent)) {
    broken.push_back(fmt::format("{:.2f} % drift", verdict.drift_percent));
  }
  if (std::isfinite(promise.within_m) && !(verdict.worst_deg <= kMostTurnDeg)) {
    broken.push_back(fmt::format("{:.2f} deg off", verdict.worst_deg));
  }
  if (promise.lost && verdict.lost > static_cast<std::size_t>(*promise.lost)) {
    broken.push_back(fmt::format("{} lost", verdict.lost));
  }
  if (promise.lost && verdict.pieces > 1) {
    broken.push_back(fmt::format("{} pieces", verdict.pieces));
  }
  if (promise.degenerate && verdict.degenerate > static_cast<std::size_t>(*promise.degenerate)) {
    broken.push_back(fmt::format("{} degenerate", verdict.degenerate));
  }
  return fmt::format("{}", fmt::join(broken, ", "));
}

}  // namespace

Verdict JudgeTrial(const std::vector<TrialFrame>& frames, const Promise& promise) {
  Verdict verdict;
  verdict.error_m.assign(frames.size(), std::numeric_limits<double>::quiet_NaN());
  verdict.error_deg = verdict.error_m;
  std::map<std::int64_t, std::vector<std::size_t>> pieces;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (IsJudged(frames[i])) {
      pieces[frames[i].piece].push_back(i);
      ++verdict.judged;
    } else if (frames[i].status == "degenerate") {
      ++verdict.degenerate;
    } else {
      ++verdict.lost;
    }
  }
  verdict.pieces = pieces.size();
  for (const auto& [piece, judged] : pieces) {
    verdict.drift_percent = std::max(verdict.drift_percent, DriftPercent(frames, judged));
    const SE3 fit = FitPiece(frames, judged);
    for (const std::size_t i : judged) {
      const SE3 error = (fit * frames[i].T_world_lidar).Inverse() * frames[i].T_world_lidar_true;
      verdict.error_m[i] = error.t.norm();
      verdict.error_deg[i] = Degrees(error.q.angularDistance(Eigen::Quaterniond::Identity()));
      verdict.worst_deg = std::max(verdict.worst_deg, verdict.error_deg[i]);
      if (!(verdict.error_m[i] <= verdict.worst_m)) {
        verdict.worst_m = verdict.error_m[i];
        verdict.worst_frame = i;
      }
    }
  }
  verdict.broken = WhatIsBroken(verdict, promise);
  verdict.kept = verdict.broken.empty();
  return verdict;
}

}  // namespace lamina
