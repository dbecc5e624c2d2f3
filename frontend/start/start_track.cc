#include "frontend/start/start_track.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/median.h"
#include "core/geometry/robust_kernel.h"
#include "frontend/matching/plane_score.h"
#include "frontend/odometry/odometry.h"

namespace lamina {
namespace {

// Kernel scale of fits: half the distance at which two minima are told apart.
constexpr double kScaleM = 0.06;
constexpr double kSameM = 0.1;
// Search limit in a small place, in standard deviations of the start speed.
constexpr double kUsualSigmas = 2.0;

// Weight along u of a cluster at p on this plane: how far the plane faces u, times the kernel's
// weight.
double FitAlong(const Surface& plane, const Eigen::Vector3d& p, const Eigen::Vector3d& u) {
  const double facing = plane.normal.cast<double>().dot(u), distance = plane.Distance(p);
  return facing * facing * GemanMcClureWeight(distance * distance / (kScaleM * kScaleM));
}

}  // namespace

StartTrack::StartTrack(const OdometryOptions& options, const VoxelMapOptions& map_options)
    // Hypotheses are minima already: a wide kernel would lead all of them into one.
    : matcher_(WithNarrowKernel(options.matcher)),
      open_sigma_m_(options.matcher.max_direction_sigma_m),
      scans_(map_options) {
  // Smaller voxels hold too few points of sparse scans.
  constexpr double kLeastVoxelM = 0.4;
  steady_.voxel_size_m = std::max(kLeastVoxelM, map_options.LeafSize());
  steady_.noise_m = map_options.noise_floor_m;
  steady_.speed_sigma_m_s = options.motion.start_speed_sigma_m_s;
  steady_.acceleration_sigma_m_s2 = options.motion.acceleration_sigma_m_s2;
}

void StartTrack::Clear() {
  state_ = State::kKept;
  seen_ = Seen();
  own_way_ = OwnWay::kHeld;
  refuted_ = false;
  scans_.Clear();
  hypotheses_.clear();
}

void StartTrack::BeginAgain() {
  if (!open()) unproven_ = after_given_up_ = false;
  Clear();
  state_ = State::kOpen;
  open_m_ = 0.0;
  open_along_.setZero();
}

void StartTrack::Add(const OdometryFrame& frame, bool stamp_made_up,
                     const std::vector<TimedCluster>& clusters) {
  if (!scans_.empty()) {
    const double gap_s = SecondsBetween(scans_.all().back().stamp_ns, frame.stamp_ns);
    if (gap_s <= 0.0 || gap_s > kMostFollowingGapS) return Clear();
  }
  seen_.stamps_recorded = seen_.stamps_recorded && !stamp_made_up;
  scans_.Add({frame.stamp_ns, clusters, frame.T_world_lidar, SweepMotion()});
  if (scans_.size() == 1) {
    steady_.max_speed_m_s = MaxSpeedMS();
    return;
  }
  if (scans_.size() == 2) seen_.sparse = ToldByBeams(frame.match);
  if (frame.sweep.of_scan) Shake(scans_.size() - 1, frame.sweep);
  seen_.all_tracked = seen_.all_tracked && frame.status == OdometryFrame::Status::kTracked;
  if (own_way_ == OwnWay::kUnrivalled) return Trust();
  if (frame.open_m > std::max(open_m_, open_sigma_m_)) {
    open_m_ = frame.open_m;
    open_along_ = frame.match.weakest_direction.tail<3>();
  }
  if (frame.match.worst_sigma_m > open_sigma_m_) ++seen_.without_planes;
  // Only a mostly translational unconstrained direction can be settled by a steady motion.
  constexpr double kMostlyWay = 0.7;
  own_way_ = open_along_.norm() > kMostlyWay ? OwnWay::kOpen : OwnWay::kHeld;
  if (seen_.shaken && !seen_.sparse) {
    // Shaking makes steps deviate from a steady trajectory, and a scan that looks shaken may be a
    // biased match: only the steady motion of all scans together tells the trajectory.
    hypotheses_.clear();
  } else if (scans_.size() == 2) {
    if (seen_.stamps_recorded) Begin(frame);
  } else {
    std::vector<Hypothesis> followed;
    for (const Hypothesis& hypothesis : hypotheses_) {
      for (Hypothesis& next : Follow(hypothesis)) followed.push_back(std::move(next));
    }
    hypotheses_ = std::move(followed);
  }
  const bool last = scans_.size() >= kMostScans;
  const bool contradicted = last && BeamsContradict(scans_.OwnPoses());
  Decide();
  if (!last || open() || given_up() || stands()) return;
  if (overruled() ? BeamsContradict(scans_.OwnPoses()) : contradicted) GiveUp();
}

void StartTrack::ShakeFirst(const SweepMotion& sweep) {
  if (open() && scans_.size() == 2 && sweep.of_scan) Shake(0, sweep);
}

void StartTrack::Shake(std::size_t scan, const SweepMotion& sweep) {
  seen_.shaken = true;
  if (seen_.sparse) return;
  SweepMotion& beside = scans_.all()[scan].sweep;
  beside = sweep;
  beside.twist -= scans_.Twist(scans_.OwnPoses(), scan);
}

double StartTrack::MaxSpeedMS() const {
  // Speed limit: the visible range (98 % quantile) divided by 1.5 s, clamped to 2 to 3 standard
  // deviations of the start speed.
  constexpr double kMostSigmas = 3.0, kFarthest = 0.98, kAheadS = 1.5;
  std::vector<double> ranges_m;
  for (const TimedCluster& cluster : scans_[0].clusters)
    ranges_m.push_back(cluster.points.mean.norm());
  const double sees_m = ranges_m.empty() ? 0.0 : Quantile(&ranges_m, kFarthest);
  const double sigma_m_s = steady_.speed_sigma_m_s;
  return std::clamp(sees_m / kAheadS, kUsualSigmas * sigma_m_s, kMostSigmas * sigma_m_s);
}

void StartTrack::Move(const SE3& correction) {
  for (StartScan& scan : scans_.all()) scan.T_world_lidar = correction * scan.T_world_lidar;
  for (Hypothesis& hypothesis : hypotheses_) {
    for (SE3& T : hypothesis.poses) T = correction * T;
  }
  match_.T_world_lidar = correction * match_.T_world_lidar;
}

std::vector<SE3> StartTrack::Minima(const std::vector<PointCluster>& clusters,
                                    const SE3& T_world_lidar, const VoxelMap& map, double middle_m,
                                    double reach_m) const {
  constexpr double kStepM = 0.5 * kScaleM, kLeastFacing = 0.3;
  // Among traffic as fast as the sensor few static surfaces face the motion: for a minimum of high
  // speed kFaintShare of the best one's evidence is enough.
  constexpr double kLeastShare = 0.3, kFaintShare = 0.1, kFastMS = 15.0;
  // The clusters that meet a plane facing u somewhere within reach.
  std::vector<Eigen::Vector3d> points;
  const double voxel_m = map.options().LeafSize();
  for (const PointCluster& cluster : clusters) {
    const Eigen::Vector3d p = T_world_lidar * cluster.mean;
    bool faces = false;
    for (double way_m = -reach_m; !faces && way_m < reach_m; way_m += 0.5 * voxel_m) {
      const Surface* plane = map.PlaneAt(p + (middle_m + way_m) * u_);
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
      const Surface* plane = map.PlaneAt(p);
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
  const bool far = steady_.max_speed_m_s > kUsualSigmas * steady_.speed_sigma_m_s;
  std::vector<SE3> poses;
  for (const auto& [evidence, way_m] : minima) {
    const bool fast = far && std::abs(way_m) > kFastMS * scans_.GapS(scans_.size() - 1);
    if (evidence < (fast ? kFaintShare : kLeastShare) * minima.front().first) continue;
    poses.emplace_back(T_world_lidar.q, T_world_lidar.t + way_m * u_);
  }
  return poses;
}

void StartTrack::Begin(const OdometryFrame& frame) {
  if (frame.match.status == MatchResult::Status::kTooFewMatches) return;
  const SE3& T_first = scans_[0].T_world_lidar;
  const SE3& T = frame.match.T_world_lidar;
  const VoxelMap map = scans_.MapOf({T_first, T}, 1);
  const std::vector<PointCluster> clusters = scans_.Deskewed(1, {T_first, T});
  u_ = LeastFaced(scans_.Faced({T_first, T}, 1));
  std::vector<SE3> starts = {T};
  // Search reach along u, to either side of the first pose.
  const double reach_m = steady_.max_speed_m_s * scans_.GapS(1) + 0.5 * kScaleM;
  for (const SE3& minimum : Minima(clusters, T, map, u_.dot(T_first.t - T.t), reach_m)) {
    if ((minimum.t - T.t).norm() > kSameM) starts.push_back(minimum);
  }
  if (starts.size() == 1 && own_way_ != OwnWay::kOpen) return;
  for (const SE3& start : starts) {
    Hypothesis hypothesis;
    hypothesis.poses = {T_first, start};
    if (!MatchSecond(&hypothesis)) continue;
    const SE3& end = hypothesis.poses.back();
    const bool known = std::any_of(
        hypotheses_.begin(), hypotheses_.end(),
        [&](const Hypothesis& other) { return (other.poses.back().t - end.t).norm() < kSameM; });
    if (!known) hypotheses_.push_back(std::move(hypothesis));
  }
  // If the descent from odometry's pose leads elsewhere, there is nothing to compare with.
  const bool found =
      !hypotheses_.empty() && (hypotheses_.front().poses.back().t - T.t).norm() < kSameM;
  if (!found) hypotheses_.clear();
}

std::vector<StartTrack::Hypothesis> StartTrack::Follow(const Hypothesis& hypothesis) const {
  // Search reach along u around the extrapolated pose, for unsteady motion.
  constexpr double kReachM = 0.25;
  std::vector<SE3> poses = hypothesis.poses;
  const std::size_t last = poses.size() - 1;
  poses.push_back(poses[last] * TwistExp(scans_.GapS(last + 1) * scans_.Twist(poses, last)));
  const VoxelMap map = scans_.MapOf(poses, last + 1);
  const std::vector<PointCluster> clusters = scans_.Deskewed(last + 1, poses);
  std::vector<SE3> starts = {poses.back()};
  for (const SE3& minimum : Minima(clusters, poses.back(), map, 0.0, kReachM)) {
    if ((minimum.t - starts.front().t).norm() > kSameWayM) starts.push_back(minimum);
  }
  // If odometry has turned away from the extrapolated motion, its pose is a start as well.
  const std::vector<SE3> own = scans_.OwnPoses();
  constexpr double kTurnedRad = Radians(1.5);
  if (RotationAngle(own.back(), starts.front()) > kTurnedRad && SameWay(hypothesis.poses, own))
    starts.push_back(own.back());
  std::vector<Hypothesis> followed;
  for (const SE3& start : starts) {
    Hypothesis next = hypothesis;
    next.poses.push_back(start);
    if (Match(map, clusters, &next)) followed.push_back(std::move(next));
  }
  return followed;
}

bool StartTrack::Match(const VoxelMap& map, const std::vector<PointCluster>& clusters,
                       Hypothesis* hypothesis) const {
  constexpr double kOpenM = 1.0;
  SE3& T = hypothesis->poses.back();
  PosePrediction prediction;
  prediction.T_world_lidar = T;
  prediction.covariance.diagonal().setConstant(kOpenM * kOpenM);
  hypothesis->match = matcher_.Match(clusters, prediction, map);
  if (hypothesis->match.status == MatchResult::Status::kTooFewMatches) return false;
  T = hypothesis->match.T_world_lidar;
  const PlaneScore score(T, map, kScaleM);
  for (const PointCluster& cluster : clusters)
    hypothesis->fits.push_back(static_cast<float>(score.Of(cluster)));
  return true;
}

bool StartTrack::MatchSecond(Hypothesis* hypothesis) const {
  // The first two scans are deskewed by the motion that their match finds.
  const int rounds = AnyTimed(scans_[1].clusters) ? 3 : 1;
  for (int round = 0; round < rounds; ++round) {
    const VoxelMap map = scans_.MapOf(hypothesis->poses, 1);
    const std::vector<PointCluster> clusters = scans_.Deskewed(1, hypothesis->poses);
    hypothesis->fits.clear();
    if (!Match(map, clusters, hypothesis)) return false;
  }
  return true;
}

void StartTrack::Overrule(const std::vector<SE3>& poses, const std::vector<SE3>& moving,
                          const MatchResult& match) {
  const bool led_elsewhere = Apart(poses, scans_.OwnPoses()) > kSameWayM;
  state_ = State::kOverruled;
  for (std::size_t k = 0; k < scans_.size(); ++k) {
    StartScan& scan = scans_.all()[k];
    scan.T_world_lidar = poses[k];
    scan.sweep = scans_.Sweep(moving, k);
  }
  match_ = match;
  // Planes that few scans have seen, such as the sheets that rings sweep, led odometry to another
  // place and would lead bundle adjustment there again: the poses are held along u. Where odometry
  // agrees, planes determine them to centimetres, better than the hypothesis does.
  constexpr double kKnownM = 0.001;
  if (led_elsewhere) {
    match_.degenerate_directions.setZero();
    match_.degenerate_directions.col(0).tail<3>() = u_;
    match_.degenerate_information = Vector6d::Unit(0) / (kKnownM * kKnownM);
  }
  hypotheses_.clear();
}

void StartTrack::Decide() {
  const bool way_open = own_way_ == OwnWay::kOpen;
  const bool last = scans_.size() >= kMostScans;
  const bool many = last || scans_.size() == kManyScans;
  if (seen_.sparse) {
    if (many && TakeByBeams()) return;
    if (seen_.shaken && last) return Clear();
    if (seen_.shaken || !many) {
      if (!hypotheses_.empty()) Rank();
      return;
    }
  }
  if (way_open && many) {
    if (TakeSteady()) return;
    if (refuted_) {
      if (last && !TakeStanding(open_along_.normalized())) GiveUp();
      return;
    }
  }
  // If planes leave the translation open in half of the scans, poses are called degenerate anyway,
  // and another start would be no better.
  if (way_open && last && 2 * seen_.without_planes >= scans_.size()) {
    if (!TakeStanding(open_along_.normalized())) Clear();
    return;
  }
  if (way_open && last && SettingOff(scans_.OwnPoses())) return CheckSettingOff(scans_.OwnPoses());
  if (hypotheses_.empty()) {
    // Without recorded stamps steps may be uneven, and then no steady motion explains them.
    if (way_open && last) return seen_.stamps_recorded ? GiveUp() : Clear();
    if (!way_open) Trust();
    return;
  }
  Rank();
  const Hypothesis& best = hypotheses_.front();
  // A hypothesis that equals the refuted odometry trajectory is refuted with it: wait.
  if (!last && refuted_ && Apart(best.poses, scans_.OwnPoses()) <= kAgreesM) return;
  // Objects that start together with the sensor give a hypothesis as smooth as the static one; the
  // two separate only after many scans.
  if (!last && SettingOff(best.poses) && (way_open || !SameWay(best.poses, scans_.OwnPoses())))
    return;
  const bool told = !way_open || (seen_.all_tracked && Steady(best.poses));
  const bool alone = hypotheses_.size() == 1 && (!way_open || scans_.size() >= kManyScans);
  if (!last && !(told && alone)) return;
  if (!told) return GiveUp();
  // Odometry's own trajectory is overruled only by one that is likelier by kLikelySigmas.
  const std::vector<SE3> own = scans_.OwnPoses();
  for (const Hypothesis& h : hypotheses_) {
    if (SameWay(h.poses, own) && Better(best, h) < kLikelySigmas) return Trust();
  }
  if (SettingOff(best.poses)) return CheckSettingOff(std::vector<SE3>(best.poses));
  CheckBest();
}

void StartTrack::TakeBest() {
  const Hypothesis best = hypotheses_.front();
  if (!IsFaced(u_, best.poses, kBestBlocks)) {
    if (!TakeStanding(u_)) Clear();
    return;
  }
  // The later scans show how far the first ones were biased before the hypotheses separated: each
  // scan is matched to the map of all others.
  std::vector<SE3> poses = best.poses;
  MatchResult match = best.match;
  bool settled = true;
  for (std::size_t k = 0; settled && k < poses.size(); ++k)
    settled = SettleBeside(k, u_, &poses, &match);
  if (settled) {
    Overrule(poses, poses, match);
  } else {
    Overrule(best.poses, best.poses, best.match);
  }
}

void StartTrack::GiveUp() {
  Clear();
  state_ = State::kGivenUp;
}

bool StartTrack::unsettled() const {
  constexpr double kOpenM = 0.1;
  if (!open()) return false;
  if (refuted_) return true;
  const std::vector<SE3> own = scans_.OwnPoses();
  // If the best hypothesis differs from odometry and starts from rest, only all scans together
  // decide.
  const bool as_best = hypotheses_.empty() || SameWay(hypotheses_.front().poses, own);
  if (!as_best && scans_.size() > 2 && SettingOff(hypotheses_.front().poses)) return true;
  return own_way_ == OwnWay::kOpen && open_m_ > kOpenM && !(seen_.all_tracked && Steady(own));
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
  // Of the states of a closed start only kOverruled is kept: it is used before the next scan is
  // taken.
  bool open = this->open(), overruled = this->overruled();
  bool unrivalled = own_way_ == OwnWay::kUnrivalled, way_open = own_way_ == OwnWay::kOpen;
  a(&open, &overruled, &unrivalled, &way_open, &seen_.all_tracked, &open_m_, &open_along_, &scans_,
    &hypotheses_, &seen_.without_planes, &u_, &unproven_, &after_given_up_, &refuted_,
    &seen_.sparse, &seen_.shaken, &seen_.stamps_recorded);
  if (a.reading()) {
    state_ = open ? State::kOpen : overruled ? State::kOverruled : State::kKept;
    own_way_ = unrivalled ? OwnWay::kUnrivalled : way_open ? OwnWay::kOpen : OwnWay::kHeld;
  }
  if (!scans_.empty()) steady_.max_speed_m_s = MaxSpeedMS();
}

}  // namespace lamina
