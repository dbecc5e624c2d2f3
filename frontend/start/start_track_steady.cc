#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "frontend/matching/direction_profile.h"
#include "frontend/matching/plane_score.h"
#include "frontend/start/start_track.h"

namespace lamina {
namespace {

// By how much a steady motion has to make the map sharper to be taken in the place of another one.
constexpr double kRefutedSigmas = 3.0;

// The direction at right angles to `without` that the fewest planes face.
Eigen::Vector3d LeastAcross(const Eigen::Matrix3d& faced, const Eigen::Vector3d& without) {
  const Eigen::Matrix3d none = without * without.transpose();
  const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - none;
  const Eigen::Matrix3d within = across * faced * across + (1.0 + faced.trace()) * none;
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(within).eigenvectors().col(0);
}

}  // namespace

std::vector<SteadyScan> StartTrack::WithoutWay(const std::vector<SE3>& poses,
                                               const Eigen::Vector3d& u, WayAlong* own) const {
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

Eigen::Matrix3d StartTrack::Faced(const std::vector<SE3>& poses, std::size_t scans) const {
  const VoxelMap map = MapOf(poses, scans);
  Eigen::Matrix3d faced = Eigen::Matrix3d::Zero();
  const std::size_t last = scans_.size() - 1;
  for (const PointCluster& cluster : DeskewClusters(scans_[last].clusters, Twist(poses, last))) {
    const Surface* plane = PlaneAt(map, poses[last] * cluster.mean);
    if (plane == nullptr) continue;
    const Eigen::Vector3d normal = plane->normal.cast<double>();
    faced += normal * normal.transpose();
  }
  return faced;
}

StartTrack::SteadyWay StartTrack::FindSteady(const std::vector<SE3>& from,
                                             const std::vector<Eigen::Vector3d>& directions,
                                             bool by_itself) const {
  // A speed that is known worse, or at the end of what is looked for, may be any.
  constexpr double kMostOpenMS = 4.0, kMostOfReach = 0.8;
  // One that matches have no say in tells at least whether the sensor stood, or went the other way.
  constexpr double kMostOpenShare = 0.5;
  // Where poses agree with a speed that is known so well, nothing is open any more.
  constexpr double kKnownMS = 1.0, kAgreesM = 0.15;
  SteadyWay way;
  way.poses = way.moving = from;
  for (const Eigen::Vector3d& u : directions) {
    WayAlong own;
    const SteadyMotionSearch search(steady_, u, WithoutWay(way.poses, u, &own));
    const FoundMotion found = search.Find();
    const WayAlong steady = search.WayUnder(found.motion);
    std::vector<SE3> moved = way.poses;
    double apart_m = 0.0;
    for (std::size_t k = 0; k < scans_.size(); ++k) {
      const double off_m = steady.positions_m[k] - own.positions_m[k];
      moved[k].t += off_m * u;
      apart_m = std::max(apart_m, std::abs(off_m));
    }
    const double speed_m_s = std::abs(found.motion.speed_m_s);
    const double most_open_m_s =
        by_itself ? std::min(kMostOpenMS, kMostOpenShare * speed_m_s) : kMostOpenMS;
    const bool told =
        found.open_speed_m_s <= most_open_m_s && speed_m_s <= kMostOfReach * steady_.most_speed_m_s;
    // Scans from nearly one place have their points in the same few spots of each wall, and look
    // sharp for that alone.
    const bool standing = std::abs(steady.positions_m.back()) < steady_.voxel_size_m;
    const bool refuted = !standing && search.Sharper(steady, own) > kRefutedSigmas;
    way.refuted = way.refuted || (refuted && !told);
    if (!told || (!refuted && (found.open_speed_m_s > kKnownMS || apart_m > kAgreesM))) continue;
    way.moving = moved;
    way.known = u;
    if (!refuted) continue;
    way.poses = moved;
    way.moved = true;
  }
  return way;
}

StartTrack::SteadyWay StartTrack::FindStraight(const std::vector<SE3>& other) const {
  // It has to be no more than the likelier one of the two.
  constexpr double kLikelySigmas = 1.0;
  const std::vector<SE3> resting(other.size(), other.front());
  const Eigen::Vector3d up = other.front().q * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d ahead = LeastAcross(Faced(resting, 1), up);
  SteadyWay way = FindSteady(resting, {ahead}, true);
  if (!way.moved) return way;
  WayAlong straight, before;
  const SteadyMotionSearch ours(steady_, ahead, WithoutWay(way.poses, ahead, &straight));
  const SteadyMotionSearch others(steady_, ahead, WithoutWay(other, ahead, &before));
  way.moved = ours.Sharper(straight, others, before) > kLikelySigmas;
  return way;
}

bool StartTrack::TakeSteady(bool* refuted) {
  const Eigen::Vector3d open = open_along_.normalized();
  const std::vector<SE3> own = OwnPoses();
  const Eigen::Vector3d up = own.back().q * Eigen::Vector3d::UnitZ();
  SteadyWay way = FindSteady(own, {LeastAcross(Faced(own, own.size()), up), open}, false);
  *refuted = way.refuted;
  if (way.moved || way.known != open) {
    SteadyWay straight = FindStraight(way.poses);
    if (straight.moved) way = std::move(straight);
    if (!way.moved) return false;
  }
  // The first one stays: the map begins there.
  MatchResult match;
  for (std::size_t k = 1; k < way.poses.size(); ++k) {
    if (!SettleBeside(k, open, &way.poses, &match)) return false;
  }
  // Twists of a steady motion are steadier than those from pose to pose.
  Overrule(way.poses, way.moving, match);
  return true;
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
