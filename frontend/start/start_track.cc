#include "frontend/start/start_track.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "core/geometry/robust_kernel.h"
#include "core/map/voxel_key.h"
#include "frontend/matching/direction_profile.h"
#include "frontend/matching/plane_score.h"
#include "frontend/odometry/odometry.h"
#include "frontend/start/block_votes.h"

namespace lamina {
namespace {

// Half the distance at which two minima are told apart.
constexpr double kScaleM = 0.06;
constexpr double kSameM = 0.1;
// Scans farther apart leave more open than matching from a prediction can bridge.
constexpr double kMostGapS = 0.25;
constexpr std::size_t kMostHypotheses = 6, kMostScans = 8;

// How much a cluster at p that meets this plane counts along u, as far as it fits.
double FitAlong(const Surface& plane, const Eigen::Vector3d& p, const Eigen::Vector3d& u) {
  const Eigen::Vector3d normal = plane.normal.cast<double>();
  const double facing = normal.dot(u), distance = normal.dot(p - plane.mean);
  return facing * facing * GemanMcClureWeight(distance * distance / (kScaleM * kScaleM));
}

// The direction that the fewest planes face.
Eigen::Vector3d LeastFaced(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar,
                           const VoxelMap& map) {
  Eigen::Matrix3d faced = Eigen::Matrix3d::Zero();
  for (const PointCluster& cluster : clusters) {
    const Surface* plane = PlaneAt(map, T_world_lidar * cluster.mean);
    if (plane == nullptr) continue;
    const Eigen::Vector3d normal = plane->normal.cast<double>();
    faced += normal * normal.transpose();
  }
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(faced).eigenvectors().col(0);
}

}  // namespace

StartTrack::StartTrack(const OdometryOptions& options, const VoxelMapOptions& map_options)
    : map_options_(map_options),
      // Hypotheses are minima already: a wide kernel would lead all of them into one.
      matcher_(WithNarrowKernel(options.matcher)),
      reach_m_s_(2.0 * options.motion.start_speed_sigma_m_s),
      open_sigma_m_(options.matcher.max_direction_sigma_m) {
  steady_.voxel_size_m = map_options.LeafSize();
  steady_.noise_m = options.matcher.noise_floor_m;
  steady_.speed_sigma_m_s = options.motion.start_speed_sigma_m_s;
  steady_.acceleration_sigma_m_s2 = options.motion.acceleration_sigma_m_s2;
  steady_.most_speed_m_s = reach_m_s_;
}

void StartTrack::Clear() {
  open_ = overruled_ = unsure_ = false;
  scans_.clear();
  hypotheses_.clear();
}

void StartTrack::Add(const OdometryFrame& frame, bool stamp_made_up,
                     const std::vector<TimedCluster>& clusters) {
  if (!scans_.empty()) {
    const double gap_s = SecondsBetween(scans_.back().stamp_ns, frame.stamp_ns);
    if (stamp_made_up || gap_s <= 0.0 || gap_s > kMostGapS) return Clear();
  }
  scans_.push_back({frame.stamp_ns, clusters, frame.T_world_lidar, Vector6d::Zero()});
  if (scans_.size() == 1) return;
  all_tracked_ = all_tracked_ && frame.status == OdometryFrame::Status::kTracked;
  if (frame.open_m > std::max(open_m_, open_sigma_m_)) {
    open_m_ = frame.open_m;
    open_along_ = frame.match.weakest_direction.tail<3>();
  }
  // A turn that is open is none of a steady way.
  constexpr double kMostlyWay = 0.7;
  unsure_ = all_tracked_ && open_along_.norm() > kMostlyWay;
  if (scans_.size() == 2) {
    Begin(frame);
  } else {
    const bool followed = followed_ && Follow(&hypotheses_.front());
    std::vector<Hypothesis> left;
    for (std::size_t i = 0; i < hypotheses_.size(); ++i) {
      const bool first = i == 0 && followed_;
      if (first ? followed : Follow(&hypotheses_[i])) left.push_back(std::move(hypotheses_[i]));
    }
    hypotheses_ = std::move(left);
    followed_ = followed;
  }
  Decide();
}

VoxelMap StartTrack::MapOf(const std::vector<SE3>& poses, std::size_t scans,
                           std::size_t without) const {
  VoxelMap map(map_options_);
  for (std::size_t k = 0; k < scans; ++k) {
    if (k == without) continue;
    const std::vector<PointCluster> clusters =
        DeskewClusters(scans_[k].clusters, Twist(poses, std::max<std::size_t>(k, 1)));
    for (const PointCluster& cluster : clusters) {
      const PointCluster moved = cluster.Moved(poses[k]);
      if (map.CanHold(moved.mean))
        map.AddWindow(map.LeafAt(moved.mean), moved, static_cast<std::int64_t>(k));
    }
  }
  map.Refresh();
  return map;
}

void StartTrack::Move(const SE3& correction) {
  for (Scan& scan : scans_) scan.T_world_lidar = correction * scan.T_world_lidar;
  for (Hypothesis& hypothesis : hypotheses_) {
    for (SE3& T : hypothesis.poses) T = correction * T;
  }
  match_.T_world_lidar = correction * match_.T_world_lidar;
}

Vector6d StartTrack::Twist(const std::vector<SE3>& poses, std::size_t scan) const {
  if (scan >= poses.size()) return Vector6d::Zero();
  const double gap_s = SecondsBetween(scans_[scan - 1].stamp_ns, scans_[scan].stamp_ns);
  return TwistLog(poses[scan - 1].Inverse() * poses[scan]) / gap_s;
}

std::vector<SE3> StartTrack::Minima(const std::vector<PointCluster>& clusters,
                                    const SE3& T_world_lidar, const VoxelMap& map) const {
  constexpr double kStepM = 0.5 * kScaleM, kLeastFacing = 0.3, kLeastShare = 0.3;
  const double gap_s = SecondsBetween(scans_[0].stamp_ns, scans_[1].stamp_ns);
  const double reach_m = reach_m_s_ * gap_s + kStepM;
  // The clusters that may meet a plane facing u at all.
  std::vector<Eigen::Vector3d> points;
  const double voxel_m = map.options().LeafSize();
  // Along u the sensor may have moved so far to either side of where it was.
  const double middle_m = u_.dot(scans_[0].T_world_lidar.t - T_world_lidar.t);
  for (const PointCluster& cluster : clusters) {
    const Eigen::Vector3d p = T_world_lidar * cluster.mean;
    bool faces = false;
    for (double way_m = -reach_m; !faces && way_m < reach_m; way_m += 0.5 * voxel_m) {
      const Surface* plane = PlaneAt(map, p + (middle_m + way_m) * u_);
      faces = plane != nullptr && std::abs(plane->normal.cast<double>().dot(u_)) > kLeastFacing;
    }
    if (faces) points.push_back(p);
  }
  const int steps = static_cast<int>(std::ceil(reach_m / kStepM));
  std::vector<std::pair<double, double>> profile;  // evidence, way
  for (int i = -steps; i <= steps; ++i) {
    const double way_m = middle_m + kStepM * i;
    double sum = 0.0;
    for (const Eigen::Vector3d& point : points) {
      const Eigen::Vector3d p = point + way_m * u_;
      const Surface* plane = PlaneAt(map, p);
      if (plane != nullptr) sum += FitAlong(*plane, p, u_);
    }
    profile.emplace_back(sum, way_m);
  }
  std::vector<std::pair<double, double>> minima;
  for (std::size_t i = 1; i + 1 < profile.size(); ++i) {
    if (profile[i].first > profile[i - 1].first && profile[i].first >= profile[i + 1].first)
      minima.push_back(profile[i]);
  }
  std::stable_sort(minima.begin(), minima.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  if (minima.size() > kMostHypotheses) minima.resize(kMostHypotheses);
  std::vector<SE3> poses;
  for (const auto& [evidence, way_m] : minima) {
    if (evidence < kLeastShare * minima.front().first) break;
    poses.emplace_back(T_world_lidar.q, T_world_lidar.t + way_m * u_);
  }
  return poses;
}

double StartTrack::Better(const Hypothesis& a, const Hypothesis& b) const {
  constexpr double kTogetherM = 4.0;
  std::map<VoxelKey, double> differences;
  std::size_t i = 0;
  for (std::size_t k = 1; k < scans_.size(); ++k) {
    for (const TimedCluster& cluster : scans_[k].clusters) {
      if (a.fits[i] >= 0.0F && b.fits[i] >= 0.0F) {
        differences[VoxelKeyOf(cluster.points.mean, 1.0 / kTogetherM)] +=
            static_cast<double>(a.fits[i] - b.fits[i]);
      }
      ++i;
    }
  }
  BlockVotes votes;
  for (const auto& [block, difference] : differences) votes.Add(difference);
  return votes.Sigmas();
}

void StartTrack::Begin(const OdometryFrame& frame) {
  if (frame.match.status == MatchResult::Status::kTooFewMatches) return;
  const SE3& T_first = scans_[0].T_world_lidar;
  const SE3& T = frame.match.T_world_lidar;
  const VoxelMap map = MapOf({T_first, T}, 1);
  const std::vector<PointCluster> clusters =
      DeskewClusters(scans_[1].clusters, Twist({T_first, T}, 1));
  u_ = LeastFaced(clusters, T, map);
  std::vector<SE3> starts = {T};
  for (const SE3& minimum : Minima(clusters, T, map)) {
    if ((minimum.t - T.t).norm() > kSameM) starts.push_back(minimum);
  }
  if (starts.size() == 1) return;
  for (const SE3& start : starts) {
    Hypothesis hypothesis;
    hypothesis.poses = {T_first, start};
    if (!Match(&hypothesis)) continue;
    const SE3& end = hypothesis.poses.back();
    const bool known = std::any_of(
        hypotheses_.begin(), hypotheses_.end(),
        [&](const Hypothesis& other) { return (other.poses.back().t - end.t).norm() < kSameM; });
    if (!known) hypotheses_.push_back(std::move(hypothesis));
  }
  // Where odometry has found no minimum, there is nothing to compare with.
  followed_ = !hypotheses_.empty() && (hypotheses_.front().poses.back().t - T.t).norm() < kSameM;
  if (!followed_) hypotheses_.clear();
}

bool StartTrack::Follow(Hypothesis* hypothesis) const {
  std::vector<SE3>& poses = hypothesis->poses;
  const std::size_t last = poses.size() - 1;
  const double gap_s = SecondsBetween(scans_[last].stamp_ns, scans_[last + 1].stamp_ns);
  poses.push_back(poses[last] * TwistExp(gap_s * Twist(poses, last)));
  return Match(hypothesis);
}

bool StartTrack::Match(Hypothesis* hypothesis) const {
  constexpr double kOpenM = 1.0;
  std::vector<SE3>& poses = hypothesis->poses;
  const std::size_t newest = poses.size() - 1;
  const std::vector<TimedCluster>& timed = scans_[newest].clusters;
  // The first two scans are deskewed by the motion that their match finds.
  const int rounds = newest == 1 && AnyTimed(timed) ? 3 : 1;
  PosePrediction prediction;
  prediction.covariance.diagonal().setConstant(kOpenM * kOpenM);
  for (int round = 0; round < rounds; ++round) {
    const VoxelMap map = MapOf(poses, newest);
    const std::vector<PointCluster> clusters = DeskewClusters(timed, Twist(poses, newest));
    prediction.T_world_lidar = poses.back();
    hypothesis->match = matcher_.Match(clusters, prediction, map);
    if (hypothesis->match.status == MatchResult::Status::kTooFewMatches) return false;
    poses.back() = hypothesis->match.T_world_lidar;
    if (round + 1 < rounds) continue;
    const PlaneScore score(poses.back(), map, kScaleM);
    for (const PointCluster& cluster : clusters)
      hypothesis->fits.push_back(static_cast<float>(score.Of(cluster)));
  }
  return true;
}

std::vector<SteadyScan> StartTrack::WithoutWay(const Eigen::Vector3d& u, WayAlong* own) const {
  std::vector<SE3> poses;
  for (const Scan& scan : scans_) poses.push_back(scan.T_world_lidar);
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

bool StartTrack::TakeSteady() {
  // A speed that is known worse, or at the end of what is looked for, may be any.
  constexpr double kMostOpenMS = 4.0, kMostOfReach = 0.8;
  constexpr double kRefutedSigmas = 3.0, kStandingSigmas = 5.0;
  // Where odometry agrees with a speed that is known so well, nothing is open any more.
  constexpr double kKnownMS = 1.0, kAgreesM = 0.15;
  const Eigen::Vector3d u = open_along_.normalized();
  WayAlong own;
  const SteadyMotionSearch search(steady_, u, WithoutWay(u, &own));
  const FoundMotion found = search.Find();
  if (found.open_speed_m_s > kMostOpenMS ||
      std::abs(found.motion.speed_m_s) > kMostOfReach * steady_.most_speed_m_s)
    return false;
  const WayAlong way = search.WayUnder(found.motion);
  std::vector<SE3> matched, steady;
  double apart_m = 0.0;
  for (std::size_t k = 0; k < scans_.size(); ++k) {
    const double off_m = way.positions_m[k] - own.positions_m[k];
    matched.push_back(scans_[k].T_world_lidar);
    steady.emplace_back(matched.back().q, matched.back().t + off_m * u);
    apart_m = std::max(apart_m, std::abs(off_m));
  }
  // Scans from nearly one place have their points in the same few spots of each wall, and look
  // sharp for that alone.
  const bool standing = std::abs(way.positions_m.back()) < steady_.voxel_size_m;
  const bool refuted = search.Sharper(way, own) > (standing ? kStandingSigmas : kRefutedSigmas);
  if (!refuted && (found.open_speed_m_s > kKnownMS || apart_m > kAgreesM)) return false;
  std::vector<SE3> poses = refuted ? steady : matched;
  // The first one stays: the map begins there.
  MatchResult match;
  for (std::size_t k = 1; k < poses.size(); ++k) {
    if (!SettleBeside(k, u, &poses, &match)) return false;
  }
  // Twists of a steady motion are steadier than those from pose to pose.
  Overrule(poses, steady, match);
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

void StartTrack::Overrule(const std::vector<SE3>& poses, const std::vector<SE3>& moving,
                          const MatchResult& match) {
  open_ = false;
  overruled_ = true;
  for (std::size_t k = 0; k < scans_.size(); ++k) {
    scans_[k].T_world_lidar = poses[k];
    scans_[k].twist = Twist(moving, std::max<std::size_t>(k, 1));
  }
  match_ = match;
  hypotheses_.clear();
}

void StartTrack::Decide() {
  if (unsure_ && scans_.size() >= kMostScans && TakeSteady()) return;
  if (hypotheses_.empty()) {
    if (!unsure_ || scans_.size() >= kMostScans) Clear();
    return;
  }
  constexpr double kClearSigmas = 3.0, kLikelySigmas = 1.0;
  Hypothesis best = hypotheses_.front();
  for (const Hypothesis& h : hypotheses_) {
    if (Better(h, best) > 0.0) best = h;
  }
  const auto refuted = [&](const Hypothesis& h) { return Better(best, h) > kClearSigmas; };
  followed_ = followed_ && !refuted(hypotheses_.front());
  hypotheses_.erase(std::remove_if(hypotheses_.begin(), hypotheses_.end(), refuted),
                    hypotheses_.end());
  if ((unsure_ || hypotheses_.size() > 1) && scans_.size() < kMostScans) return;
  // Of several that are left at the end one that is likely better is followed.
  if (followed_ && Better(best, hypotheses_.front()) < kLikelySigmas) return Clear();
  Overrule(best.poses, best.poses, best.match);
}

Matrix6d StartTrack::Spread(const SE3& T_world_lidar) const {
  Matrix6d spread = Matrix6d::Zero();
  if (!contested()) return spread;
  for (const Hypothesis& hypothesis : hypotheses_) {
    const Vector6d delta = LocalDelta(T_world_lidar, hypothesis.poses.back());
    spread += delta * delta.transpose();
  }
  return spread;
}

void StartTrack::Archive(StateArchive& a) {
  a(&open_, &overruled_, &unsure_, &all_tracked_, &open_m_, &open_along_, &scans_, &hypotheses_,
    &followed_, &u_);
}

}  // namespace lamina
