#include "backend/pieces/first_pose.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "core/base/angle.h"
#include "frontend/matching/pose_hypotheses.h"
#include "frontend/matching/pose_search.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {
namespace {

// Error of the relative pose of two scans that met planes of one another.
constexpr double kOpenM = 0.5, kOpenRad = 0.1;
// Differences that bundle adjustment settles.
constexpr double kSettledM = 0.03, kSettledRad = Radians(0.3);
// Margin by which another pose must fit better, at a scale that distinguishes decimetres.
constexpr double kScaleM = 0.1, kClearSigmas = 5.0, kClearEvidence = 0.02;

// Most frames that may be off together, and fewest frames after them that show it.
constexpr std::size_t kMostAside = 5, kFewestOthers = 4;

// The pose of a frame in the map of others, searched for about `expected`; none if it does not
// clearly differ from the one that the frame has.
std::optional<SE3> PoseByOthers(const WindowFrame& frame, const SE3& expected, const VoxelMap& map,
                                double usual_inliers, const OdometryOptions& options) {
  PosePrediction prediction;
  prediction.T_world_lidar = expected;
  prediction.covariance.diagonal() << Eigen::Vector3d::Constant(kOpenRad * kOpenRad),
      Eigen::Vector3d::Constant(kOpenM * kOpenM);
  const ScanMatcher matcher(options.matcher);
  MatchResult match = matcher.MatchPose(frame.deskewed, prediction, map);
  if (options.search.enabled &&
      match.inlier_share < options.search.trigger_inlier_ratio * usual_inliers) {
    PoseHypotheses hypotheses;
    hypotheses.dense = TurnsAbout(options.search, {expected});
    const PoseSearch search(options.search, matcher);
    match = search.Best({frame.deskewed, prediction, map}, &hypotheses, match);
  }
  if (match.status != MatchResult::Status::kConverged || match.degenerate > 0) return std::nullopt;
  const SE3& found = match.T_world_lidar;
  if (AreClose(found, frame.T_world_lidar, kSettledM, kSettledRad)) return std::nullopt;
  const FitDifference better =
      matcher.Compare(frame.deskewed, found, frame.T_world_lidar, map, kScaleM);
  if (better.evidence_sigmas < kClearSigmas || better.evidence < kClearEvidence)
    return std::nullopt;
  return found;
}

}  // namespace

std::vector<SE3> FirstPosesByOthers(const std::deque<WindowFrame>& frames, double usual_inliers,
                                    const OdometryOptions& options,
                                    const VoxelMapOptions& map_options) {
  const std::size_t most = frames.size() - std::min(frames.size(), kFewestOthers);
  const std::size_t aside = std::clamp<std::size_t>(most, 1, kMostAside);
  VoxelMap map(map_options);
  const auto add = [&](std::size_t i, const SE3& T_world_lidar) {
    map.AddFrame(frames[i].deskewed, T_world_lidar, static_cast<std::int64_t>(i));
  };
  for (std::size_t i = aside; i < frames.size(); ++i) add(i, frames[i].T_world_lidar);
  std::vector<SE3> poses(aside);
  std::size_t moved = 0;
  SE3 correction;  // of the one after
  for (std::size_t i = aside; i-- > 0;) {
    map.Refresh();
    const SE3& T_world_lidar = frames[i].T_world_lidar;
    const std::optional<SE3> found =
        PoseByOthers(frames[i], correction * T_world_lidar, map, usual_inliers, options);
    if (found) moved = std::max(moved, i + 1);
    poses[i] = found.value_or(T_world_lidar);
    correction = poses[i] * T_world_lidar.Inverse();
    if (i > 0) add(i, poses[i]);
  }
  poses.resize(moved);
  return poses;
}

}  // namespace lamina
