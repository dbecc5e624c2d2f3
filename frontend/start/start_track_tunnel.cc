// The start of a sensor in a corridor or a tunnel, where no surface faces the direction of travel.
#include <vector>

#include "frontend/matching/direction_profile.h"
#include "frontend/start/start_track.h"

namespace lamina {

bool StartTrack::IsFaced(const Eigen::Vector3d& u, const std::vector<SE3>& poses,
                         double least_blocks) const {
  // Blocks are never negative: where the first scans have enough, the others need no map.
  const double least = least_blocks * static_cast<double>(poses.size());
  double blocks = 0.0;
  for (std::size_t k = 0; blocks < least && k < poses.size(); ++k) {
    const VoxelMap map = scans_.MapOf(poses, poses.size(), k);
    const std::vector<PointCluster> clusters = scans_.Deskewed(k, poses);
    blocks += DirectionProfile(clusters, map, poses[k], StraightAlong(u)).Blocks();
  }
  return blocks >= least;
}

bool StartTrack::IsTunnel(const Eigen::Vector3d& along) const {
  const std::vector<SE3> own = scans_.OwnPoses();
  if (IsFaced(along, own, kSteadyBlocks)) return false;
  const SteadyAlong steady = FindAlong(own, along, steady_.noise_m, Asked::kIfRefutes);
  return !steady.refutes || !IsFaced(along, steady.poses, kSteadyBlocks);
}

bool StartTrack::TakeStanding(const Eigen::Vector3d& along) {
  // Scans with less overlap were not taken at one place.
  constexpr double kLeastOverlap = 0.5;
  if (!IsTunnel(along)) return false;
  std::vector<SE3> poses = scans_.OwnPoses();
  for (SE3& T : poses) T.t -= along.dot(T.t - poses.front().t) * along;
  MatchResult match;
  if (!SettleBeside(poses.size() - 1, along, &poses, &match)) return false;
  if (match.overlap() < kLeastOverlap) return false;
  match.MakeDegenerate(StraightAlong(along));
  u_ = along;
  Overrule(poses, poses, match);
  state_ = State::kStands;
  return true;
}

}  // namespace lamina
