#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "frontend/matching/direction_profile.h"
#include "frontend/start/start_track.h"

namespace lamina {
namespace {

// Scans from nearly one place have their points in the same few spots of each wall, and look sharp
// for that alone: a way of less than a voxel refutes nothing.
constexpr double kRefutedSigmas = 3.0;
// Ways that differ by less are one.
constexpr double kAgreesM = 0.15;

}  // namespace

std::vector<SteadyScan> StartTrack::WithoutWay(const Eigen::Vector3d& u, WayAlong* own) const {
  const std::vector<SE3> poses = OwnPoses();
  std::vector<SteadyScan> scans;
  for (std::size_t k = 0; k < scans_.size(); ++k) {
    const SE3& T = poses[k];
    Vector6d twist = Twist(poses, std::max<std::size_t>(k, 1));
    const Eigen::Vector3d u_lidar = T.q.conjugate() * u;
    own->speeds_m_s.push_back(u_lidar.dot(twist.tail<3>()));
    own->positions_m.push_back(u.dot(T.t - poses[0].t));
    twist.tail<3>() -= own->speeds_m_s.back() * u_lidar;
    SteadyScan scan;
    scan.time_s = SecondsBetween(scans_[0].stamp_ns, scans_[k].stamp_ns);
    scan.centre = T.t - own->positions_m.back() * u;
    for (const PointCluster& cluster : DeskewClusters(scans_[k].clusters, twist))
      scan.clusters.push_back(cluster.Moved(SE3(T.q, scan.centre)));
    if (AnyTimed(scans_[k].clusters)) {
      for (const TimedCluster& cluster : scans_[k].clusters)
        scan.cluster_times_s.push_back(cluster.mean_time_s);
    }
    scans.push_back(std::move(scan));
  }
  return scans;
}

StartTrack::SteadyWay StartTrack::FindSteady(const Eigen::Vector3d& u) const {
  // A speed that is known worse, or at the end of what is looked for, may be any.
  constexpr double kMostOpenMS = 4.0, kMostOfReach = 0.8;
  WayAlong own;
  const SteadyMotionSearch search(steady_, u, WithoutWay(u, &own));
  SteadyWay steady;
  steady.found = search.Find();
  steady.known = steady.found.open_speed_m_s <= kMostOpenMS &&
                 std::abs(steady.found.motion.speed_m_s) <= kMostOfReach * steady_.most_speed_m_s;
  const WayAlong way = search.WayUnder(steady.found.motion);
  for (std::size_t k = 0; k < scans_.size(); ++k) {
    const double off_m = way.positions_m[k] - own.positions_m[k];
    const SE3& T = scans_[k].T_world_lidar;
    steady.poses.emplace_back(T.q, T.t + off_m * u);
    steady.apart_m = std::max(steady.apart_m, std::abs(off_m));
  }
  steady.way_m = std::abs(way.positions_m.back());
  steady.sharper = search.Sharper(way, own);
  return steady;
}

bool StartTrack::TakeSettled(std::vector<SE3> poses, const std::vector<SE3>& steady,
                             const Eigen::Vector3d& u) {
  // The first one stays: the map begins there.
  MatchResult match;
  for (std::size_t k = 1; k < poses.size(); ++k) {
    if (!SettleBeside(k, u, &poses, &match)) return false;
  }
  // Twists of a steady motion are steadier than those from pose to pose.
  Overrule(poses, steady, match);
  return true;
}

bool StartTrack::TakeSteady() {
  // Where odometry agrees with a speed that is known so well, nothing is open any more.
  constexpr double kKnownMS = 1.0;
  const Eigen::Vector3d u = open_along_.normalized();
  const SteadyWay steady = FindSteady(u);
  if (!steady.known) return false;
  const bool refuted = steady.way_m >= steady_.voxel_size_m && steady.sharper > kRefutedSigmas;
  if (!refuted && (steady.found.open_speed_m_s > kKnownMS || steady.apart_m > kAgreesM))
    return false;
  return TakeSettled(refuted ? steady.poses : OwnPoses(), steady.poses, u);
}

void StartTrack::CheckSettingOff() {
  constexpr double kDoubtedSigmas = 2.0;
  const std::vector<SE3> own = OwnPoses();
  const std::size_t last = own.size() - 1;
  const Eigen::Vector3d u = LeastFaced(DeskewClusters(scans_[last].clusters, Twist(own, last)),
                                       own[last], MapOf(own, last));
  const SteadyWay steady = FindSteady(u);
  if (steady.apart_m <= kAgreesM || steady.sharper < kDoubtedSigmas) return Clear();
  const bool refuted =
      steady.known && steady.way_m >= steady_.voxel_size_m && steady.sharper > kRefutedSigmas;
  if (!refuted || !TakeSettled(steady.poses, steady.poses, u)) GiveUp();
}

bool StartTrack::SettleBeside(std::size_t scan, const Eigen::Vector3d& u, std::vector<SE3>* poses,
                              MatchResult* match) const {
  // What a steady motion leaves open of a pose.
  constexpr double kOpenM = 0.05;
  const VoxelMap map = MapOf(*poses, poses->size(), scan);
  const std::vector<PointCluster> clusters =
      DeskewClusters(scans_[scan].clusters, Twist(*poses, std::max<std::size_t>(scan, 1)));
  SE3& T = (*poses)[scan];
  Vector6d along = Vector6d::Zero();
  along.tail<3>() = u;
  const DirectionProfile profile(clusters, map, T, along, steady_.noise_m);
  const DirectionProfile::Posterior posterior = profile.With(0.0, kOpenM);
  PosePrediction prediction;
  prediction.T_world_lidar = T;
  prediction.covariance.diagonal().setConstant(kOpenM * kOpenM);
  *match = matcher_.MatchKnown(clusters, profile.At(posterior.mean_m), {along, posterior.sigma_m},
                               prediction, map);
  if (match->status == MatchResult::Status::kTooFewMatches) return false;
  T = match->T_world_lidar;
  return true;
}

}  // namespace lamina
