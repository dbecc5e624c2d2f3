#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "frontend/matching/direction_profile.h"
#include "frontend/matching/plane_score.h"
#include "frontend/start/start_track.h"

namespace lamina {
namespace {

// Standard deviations by which a steady motion must make the map sharper to replace another one.
constexpr double kRefutedSigmas = 3.0;

// The direction at right angles to `without` that the fewest planes face.
Eigen::Vector3d LeastAcross(const Eigen::Matrix3d& faced, const Eigen::Vector3d& without) {
  const Eigen::Matrix3d none = without * without.transpose();
  const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - none;
  const Eigen::Matrix3d within = across * faced * across + (1.0 + faced.trace()) * none;
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(within).eigenvectors().col(0);
}

bool IsAlong(const Eigen::Vector3d& u, const Eigen::Vector3d& axis) {
  constexpr double kMostly = 0.7;
  return std::abs(u.dot(axis)) > kMostly;
}

}  // namespace

std::vector<SteadyScan> StartTrack::WithoutWay(const std::vector<SE3>& poses,
                                               const Eigen::Vector3d& u, WayAlong* own) const {
  std::vector<SteadyScan> scans;
  for (std::size_t k = 0; k < scans_.size(); ++k) {
    const SE3& T = poses[k];
    SweepMotion sweep = scans_.Sweep(poses, k);
    const Eigen::Vector3d u_lidar = T.q.conjugate() * u;
    own->speeds_m_s.push_back(u_lidar.dot(scans_.Twist(poses, k).tail<3>()));
    own->positions_m.push_back(u.dot(T.t - poses[0].t));
    sweep.twist.tail<3>() -= own->speeds_m_s.back() * u_lidar;
    SteadyScan scan;
    scan.time_s = SecondsBetween(scans_[0].stamp_ns, scans_[k].stamp_ns);
    scan.centre = T.t - own->positions_m.back() * u;
    for (const PointCluster& cluster : DeskewClusters(scans_[k].clusters, sweep))
      scan.clusters.push_back(cluster.Moved(SE3(T.q, scan.centre)));
    if (AnyTimed(scans_[k].clusters)) {
      for (const TimedCluster& cluster : scans_[k].clusters)
        scan.cluster_times_s.push_back(cluster.mean_time_s);
    }
    scans.push_back(std::move(scan));
  }
  return scans;
}

StartTrack::SteadyAlong StartTrack::FindAlong(const std::vector<SE3>& from,
                                              const Eigen::Vector3d& u, double noise_m,
                                              Asked asked) const {
  // The speed counts as undetermined if more than kMostOpenMS of it is ambiguous, if it is near the
  // search limit, or if standing or reversing cannot be excluded, unless it is known to kKnownMS.
  constexpr double kMostOpenMS = 4.0, kMostOfReach = 0.8;
  const Eigen::Vector3d axis = from.front().q * Eigen::Vector3d::UnitZ();
  SteadyAlong steady;
  steady.poses = from;
  steady.along = u;
  WayAlong own;
  SteadyMotionOptions options = steady_;
  options.noise_m = noise_m;
  const SteadyMotionSearch search(options, u, axis, WithoutWay(from, u, &own));
  // Sheets of rings lie one above the other. Shifted along the axis from scan to scan they stay
  // apart, each as thin as a wall: their sharpness does not determine a motion along the axis.
  if (IsAlong(u, axis) && search.rays_repeat()) return steady;
  const std::optional<FoundMotion> beside =
      asked == Asked::kIfRefutes ? search.FindUnlessRefutedBy(own) : search.Find();
  steady.refuted = !beside;
  if (!beside) return steady;
  const FoundMotion& found = *beside;
  const WayAlong way = search.WayUnder(found.motion);
  for (std::size_t k = 0; k < from.size(); ++k) {
    const double off_m = way.positions_m[k] - own.positions_m[k];
    steady.poses[k].t += off_m * u;
    steady.apart_m = std::max(steady.apart_m, std::abs(off_m));
  }
  steady.speed_m_s = std::abs(found.motion.speed_m_s);
  // Scans from nearly one place have their points in the same few spots of each wall, and look
  // sharp for that reason alone: standing refutes nothing.
  const bool standing = std::abs(way.positions_m.back()) < steady_.voxel_size_m;
  steady.sharper = search.Sharper(found, own);
  steady.refutes = !standing && steady.sharper > kRefutedSigmas;
  steady.open_speed_m_s = asked == Asked::kAll || steady.refutes
                              ? search.OpenSpeed(found)
                              : std::numeric_limits<double>::infinity();
  steady.told = steady.open_speed_m_s <= std::max(kKnownMS, steady.speed_m_s) &&
                steady.open_speed_m_s <= kMostOpenMS &&
                steady.speed_m_s <= kMostOfReach * options.max_speed_m_s;
  return steady;
}

StartTrack::SteadyWay StartTrack::FindSteady(const std::vector<SE3>& from,
                                             const std::vector<Eigen::Vector3d>& directions) const {
  SteadyWay way;
  way.poses = way.moving = from;
  for (const Eigen::Vector3d& u : directions) {
    const SteadyAlong steady = FindAlong(way.poses, u, steady_.noise_m, Asked::kAll);
    const bool agrees = steady.open_speed_m_s <= kKnownMS && steady.apart_m <= kAgreesM;
    way.refuted = way.refuted || (steady.refutes && !steady.told);
    way.doubted = way.doubted ||
                  (!steady.refutes && steady.apart_m > kAgreesM && steady.sharper > kDoubtedSigmas);
    if (!steady.told || !(steady.refutes || agrees)) continue;
    way.ahead_known = way.ahead_known || u == directions.front();
    way.moving = steady.poses;
    way.known = u;
    if (!steady.refutes) continue;
    way.poses = steady.poses;
    way.moved = true;
    way.open_speed_m_s = std::max(way.open_speed_m_s, steady.open_speed_m_s);
  }
  return way;
}

double StartTrack::OpenM(const SteadyWay& way) const {
  return 0.5 * way.open_speed_m_s * scans_.LengthS();
}

bool StartTrack::FindStraight(const std::vector<SE3>& other, std::vector<SE3>* poses) const {
  // It need only be likelier than the other trajectory, and exclude standing and reversing; matches
  // are not used.
  constexpr double kMostOpenShare = 0.5;
  const std::vector<SE3> resting(other.size(), other.front());
  const Eigen::Vector3d up = other.front().q * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d ahead = LeastAcross(scans_.Faced(resting, 1), up);
  const SteadyAlong steady = FindAlong(resting, ahead, steady_.noise_m, Asked::kOpenSpeedIfRefutes);
  if (!steady.told || !steady.refutes || steady.open_speed_m_s > kMostOpenShare * steady.speed_m_s)
    return false;
  WayAlong straight, before;
  const SteadyMotionSearch ours(steady_, ahead, up, WithoutWay(steady.poses, ahead, &straight));
  const SteadyMotionSearch others(steady_, ahead, up, WithoutWay(other, ahead, &before));
  *poses = steady.poses;
  return ours.Sharper(straight, others, before) > kLikelySigmas;
}

bool StartTrack::SettleOthers(const Eigen::Vector3d& u, std::vector<SE3>* poses,
                              MatchResult* match) const {
  for (std::size_t k = 1; k < poses->size(); ++k) {
    if (!SettleBeside(k, u, poses, match)) return false;
  }
  return true;
}

bool StartTrack::Leaps(const std::vector<SE3>& poses) const {
  // Allowed deviation, and standard deviation of a settled pose.
  constexpr double kSigmas = 3.0, kPoseM = 0.03;
  for (std::size_t k = 2; k < poses.size(); ++k) {
    const Eigen::Vector3d change = (poses[k].t - poses[k - 1].t) / scans_.GapS(k) -
                                   (poses[k - 1].t - poses[k - 2].t) / scans_.GapS(k - 1);
    if (change.norm() > kSigmas * std::sqrt(ChangeVariance(k, kPoseM))) return true;
  }
  return false;
}

bool StartTrack::TakeSettled(std::vector<SE3> poses, const std::vector<SE3>& steady,
                             const Eigen::Vector3d& u) {
  // If scans settle farther away than this, the motion was known worse than to kToldM.
  constexpr double kAsideM = 3.0 * kToldM;
  constexpr int kMostRounds = 5;
  constexpr double kSettledM = 0.02;
  const std::vector<SE3> known = poses;
  MatchResult match, first;
  if (!SettleOthers(u, &poses, &match)) return false;
  const auto led = [&] {
    return poses.size() > 2 ? poses[1] * TwistExp(-scans_.GapS(1) * scans_.Twist(poses, 2))
                            : poses[0];
  };
  const auto first_is_left = [&] { return (led().t - poses[0].t).norm() > kAsideM; };
  // In that case each round brings them nearer to the right poses, and the first scan follows.
  if (Apart(known, poses) > kAsideM || first_is_left()) {
    for (int round = 0; round < kMostRounds; ++round) {
      const std::vector<SE3> before = poses;
      if (first_is_left()) {
        poses[0] = led();
        if (!SettleBeside(0, u, &poses, &first)) return false;
      }
      if (!SettleOthers(u, &poses, &match)) return false;
      if (Apart(before, poses) < kSettledM) break;
    }
  }
  if (Leaps(poses) || !IsFaced(u, poses, kSteadyBlocks)) return false;
  u_ = u;
  // Twists of a steady motion have less noise than those from pose to pose.
  Overrule(poses, steady, match);
  state_ = State::kToldByAll;
  return true;
}

bool StartTrack::TakeSteady() {
  const Eigen::Vector3d open = open_along_.normalized();
  const std::vector<SE3> own = scans_.OwnPoses();
  const Eigen::Vector3d up = own.back().q * Eigen::Vector3d::UnitZ();
  const SteadyWay way = FindSteady(own, {LeastAcross(scans_.Faced(own, own.size()), up), open});
  refuted_ = way.refuted || way.doubted;
  const bool settled = !way.moved && !way.doubted && way.ahead_known && way.known == open;
  std::vector<SE3> straight;
  const bool is_straight = !settled && FindStraight(way.poses, &straight);
  const std::vector<SE3>& poses = is_straight ? straight : way.poses;
  if (!(is_straight || settled || way.moved) || !Parted(poses)) return false;
  if (scans_.size() < kMostScans && !is_straight && OpenM(way) > kAgreesM) {
    refuted_ = true;  // more scans tell it better
    return false;
  }
  // If the scans do not converge on this motion it is unusable, and others are no better: odometry
  // counts as refuted.
  const bool taken = TakeSettled(poses, is_straight ? straight : way.moving, open);
  refuted_ = refuted_ || !taken;
  return taken;
}

bool StartTrack::SettleBeside(std::size_t scan, const Eigen::Vector3d& u, std::vector<SE3>* poses,
                              MatchResult* match) const {
  const VoxelMap map = scans_.MapOf(*poses, poses->size(), scan);
  const std::vector<PointCluster> clusters = scans_.Deskewed(scan, *poses);
  SE3& T = (*poses)[scan];
  const Vector6d along = StraightAlong(u);
  const DirectionProfile profile(clusters, map, T, along);
  const DirectionProfile::Posterior posterior = profile.With(0.0, kToldM);
  PosePrediction prediction;
  prediction.T_world_lidar = T;
  prediction.covariance.diagonal().setConstant(kToldM * kToldM);
  *match = matcher_.MatchKnown(clusters, profile.At(posterior.mean_m), {along, posterior.sigma_m},
                               prediction, map);
  if (match->status == MatchResult::Status::kTooFewMatches) return false;
  T = match->T_world_lidar;
  return true;
}

}  // namespace lamina
