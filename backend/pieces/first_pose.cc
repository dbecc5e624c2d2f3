#include "backend/pieces/first_pose.h"

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/angle.h"
#include "frontend/matching/pose_hypotheses.h"
#include "frontend/matching/pose_search.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {
namespace {

// What two scans may be wrong by that met planes of one another.
constexpr double kOpenM = 0.5, kOpenRad = 0.1;
// Differences that bundle adjustment settles.
constexpr double kSettledM = 0.03, kSettledRad = Radians(0.3);
// By how much it must fit better, at a scale on which decimetres differ.
constexpr double kScaleM = 0.1, kClearSigmas = 5.0, kClearEvidence = 0.02;

VoxelMap MapOfOthers(const std::deque<WindowFrame>& frames, const VoxelMapOptions& options) {
  VoxelMap map(options);
  for (std::size_t i = 1; i < frames.size(); ++i)
    map.AddFrame(frames[i].deskewed, frames[i].T_world_lidar, static_cast<std::int64_t>(i));
  map.Refresh();
  return map;
}

}  // namespace

std::optional<SE3> FirstPoseByOthers(const std::deque<WindowFrame>& frames, double usual_inliers,
                                     const OdometryOptions& options,
                                     const VoxelMapOptions& map_options) {
  const std::vector<PointCluster>& clusters = frames.front().deskewed;
  const SE3& T_world_first = frames.front().T_world_lidar;
  const VoxelMap map = MapOfOthers(frames, map_options);
  PosePrediction prediction;
  prediction.T_world_lidar = T_world_first;
  prediction.covariance.diagonal() << Eigen::Vector3d::Constant(kOpenRad * kOpenRad),
      Eigen::Vector3d::Constant(kOpenM * kOpenM);
  const ScanMatcher matcher(options.matcher);
  MatchResult match = matcher.MatchPose(clusters, prediction, map);
  if (options.search.enabled &&
      match.inlier_share < options.search.trigger_inlier_ratio * usual_inliers) {
    PoseHypotheses hypotheses;
    hypotheses.dense = TurnsAbout(options.search, {T_world_first});
    const PoseSearch search(options.search, &matcher);
    match = search.Best({clusters, prediction, map}, &hypotheses, match);
  }
  if (match.status != MatchResult::Status::kConverged || match.degenerate > 0) return std::nullopt;
  const SE3& found = match.T_world_lidar;
  if (AreClose(found, T_world_first, kSettledM, kSettledRad)) return std::nullopt;
  const FitDifference better = matcher.Compare(clusters, found, T_world_first, map, kScaleM);
  if (better.evidence_sigmas < kClearSigmas || better.evidence < kClearEvidence)
    return std::nullopt;
  return found;
}

}  // namespace lamina
