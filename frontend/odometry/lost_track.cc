#include "frontend/odometry/lost_track.h"

#include <algorithm>
#include <utility>

#include "frontend/odometry/odometry.h"
#include "frontend/scan/scan_clusters.h"

namespace lamina {

LostTrack::LostTrack(const OdometryOptions& options, const VoxelMapOptions& map_options)
    : matcher_(options.matcher),
      map_options_(map_options),
      motion_options_(options.motion),
      search_options_(options.search),
      motion_(options.motion) {}

void LostTrack::Add(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                    const Vector6d& twist, double usual_inliers) {
  Scan scan;
  scan.stamp_ns = stamp_ns;
  // An earlier stamp shows that those before were wrong.
  const bool later = scans_ > 0 && stamp_ns > kept_.back().stamp_ns;
  if (later && Agrees(stamp_ns, clusters, usual_inliers, &scan)) {
    motion_.Accept(stamp_ns, scan.T_first_lidar, true);
  } else {
    Clear();
    motion_.Accept(stamp_ns, SE3(), false);
    motion_.Assume(twist);
    first_stamp_ns_ = stamp_ns;
    scan.clusters = DeskewClusters(clusters, twist);
  }
  scan.timed = clusters;
  ++scans_;
  kept_.push_back(std::move(scan));
  if (kept_.size() > kKept) kept_.pop_front();
}

void LostTrack::Clear() {
  kept_.clear();
  scans_ = 0;
  guesses_ = 0;
}

int LostTrack::Guessed(const SE3& T_world_newest) const {
  constexpr double kSameM = 0.5, kSameRad = 0.03;
  const SE3 T_world_first = T_world_newest * T_first_newest().Inverse();
  const bool same = (T_world_first.t - T_world_first_guess_.t).norm() < kSameM &&
                    RotationAngle(T_world_first, T_world_first_guess_) < kSameRad;
  return same ? guesses_ : 0;
}

void LostTrack::Guess(const SE3& T_world_newest) {
  guesses_ = Guessed(T_world_newest) + 1;
  T_world_first_guess_ = T_world_newest * T_first_newest().Inverse();
}

bool LostTrack::Agrees(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                       double usual_inliers, Scan* scan) const {
  // One scan of few rings overlaps little with the next one, however well they agree.
  constexpr double kLeastOverlap = 0.3, kLeastOverlapOfTwo = 0.18;
  // In a forest, where a fifth of a scan lies on planes, two scans share half as much at the right
  // pose, and a third at a wrong one.
  constexpr double kLeastOfUsual = 0.5;
  const double usual = usual_inliers > 0.0 ? kLeastOfUsual * usual_inliers : 1.0;
  const double least_overlap =
      std::min(kept_.size() > 1 ? kLeastOverlap : kLeastOverlapOfTwo, usual);
  VoxelMap map(map_options_);
  std::int64_t frame = 0;
  for (const Scan& other : kept_) map.AddFrame(other.clusters, other.T_first_lidar, frame++);
  map.Refresh();
  const PosePrediction prediction = motion_.Predict(stamp_ns);
  Vector6d twist = motion_.Twist(stamp_ns);
  // Scans that follow one another as a sensor delivers them lie where the motion before leads.
  std::vector<PointCluster> deskewed = DeskewClusters(clusters, twist);
  const bool follows = motion_.stamps_recorded() && motion_.Gap(stamp_ns) <= kMostFollowingGapS;
  const bool far = search_options_.enabled && !follows;
  MatchResult match =
      far ? SearchFor(deskewed, prediction, map) : matcher_.MatchPose(deskewed, prediction, map);
  const double dt = motion_.Gap(stamp_ns);
  // Scans of a shaken sensor are distorted, each in its own way, until they are deskewed by the
  // motion that the match has found.
  constexpr int kMostPasses = 4;
  const bool timed = AnyTimed(clusters) && motion_.TellsSweep(stamp_ns);
  MatchResult next = match;
  std::vector<PointCluster> again;
  for (int pass = 0; pass < kMostPasses && timed && match.fit() < kLeastFit; ++pass) {
    if (next.status == MatchResult::Status::kTooFewMatches) break;
    DeskewClusters(clusters, motion_.TwistTo(next.T_world_lidar, dt), &again);
    next = matcher_.Match(again, prediction, next.T_world_lidar, map);
    if (next.fit() <= match.fit()) continue;
    match = next;
    deskewed.swap(again);
  }
  if (match.status == MatchResult::Status::kTooFewMatches || match.overlap() < least_overlap)
    return false;
  if (match.fit() < kLeastFit && (far || !FitsHereAlone(deskewed, prediction, map, match)))
    return false;
  if (dt > 0.0) twist = motion_.TwistTo(match.T_world_lidar, dt);
  scan->T_first_lidar = match.T_world_lidar;
  scan->clusters = DeskewClusters(clusters, twist);
  return true;
}

MatchResult LostTrack::SearchFor(const std::vector<PointCluster>& clusters,
                                 const PosePrediction& prediction, const VoxelMap& map) const {
  const PoseSearch search(search_options_, matcher_);
  const SearchedScan scan{clusters, prediction, map, !motion_.moving_known()};
  PoseHypotheses hypotheses = HypothesesFor(prediction);
  MatchResult match = search.Best(scan, &hypotheses, matcher_.MatchPose(clusters, prediction, map));
  match = matcher_.Match(clusters, prediction, match.T_world_lidar, map);
  if (match.status == MatchResult::Status::kConverged && !search.Unique(scan, hypotheses, match))
    match.status = MatchResult::Status::kTooFewMatches;
  return match;
}

PoseHypotheses LostTrack::HypothesesFor(const PosePrediction& prediction) const {
  const SE3& last = motion_.T_world_last();
  return motion_.moving_known() ? PoseHypotheses::GoingOn(search_options_, prediction, last)
                                : PoseHypotheses::Starting(search_options_, prediction, last);
}

bool LostTrack::FitsHereAlone(const std::vector<PointCluster>& clusters,
                              const PosePrediction& prediction, const VoxelMap& map,
                              const MatchResult& match) const {
  if (match.status != MatchResult::Status::kConverged || match.fit() < MatchResult::kFollowingFit)
    return false;
  const SearchedScan scan{clusters, prediction, map, !motion_.moving_known()};
  return PoseSearch(search_options_, matcher_).Unique(scan, HypothesesFor(prediction), match);
}

bool LostTrack::Drivable(const std::vector<SE3>& poses) const {
  // Standard deviations of the acceleration between three scans, and the error of their poses.
  constexpr double kSigmas = 3.0, kPosesM = 0.05;
  const double most_m_s2 = kSigmas * motion_options_.acceleration_sigma_m_s2;
  for (std::size_t k = 2; k < poses.size(); ++k) {
    const double before_s = SecondsBetween(kept_[k - 2].stamp_ns, kept_[k - 1].stamp_ns);
    const double after_s = SecondsBetween(kept_[k - 1].stamp_ns, kept_[k].stamp_ns);
    if (before_s <= 0.0 || after_s <= 0.0) return false;
    const Eigen::Vector3d expected =
        poses[k - 1].t + after_s / before_s * (poses[k - 1].t - poses[k - 2].t);
    const double most_m = 0.5 * most_m_s2 * after_s * (before_s + after_s) + kPosesM;
    if ((poses[k].t - expected).norm() > most_m) return false;
  }
  return true;
}

bool LostTrack::Straighten(const PosePrediction& newest, const VoxelMap& map,
                           double least_inliers) {
  constexpr double kBentM = 0.1, kBentRad = 0.02;
  if (kept_.size() < 2) return false;
  const SE3 T_world_first = newest.T_world_lidar * T_first_newest().Inverse();
  std::vector<SE3> poses;
  bool bent = false;
  for (const Scan& scan : kept_) {
    const SE3 together = T_world_first * scan.T_first_lidar;
    const MatchResult alone = matcher_.MatchPose(scan.clusters, {together, newest.covariance}, map);
    if (alone.status != MatchResult::Status::kConverged || alone.fit() < kLeastFit ||
        alone.inlier_share < least_inliers)
      return false;
    const SE3& pose = alone.T_world_lidar;
    bent =
        bent || (pose.t - together.t).norm() > kBentM || RotationAngle(pose, together) > kBentRad;
    poses.push_back(pose);
  }
  if (!bent || !Drivable(poses)) return false;
  const SE3 T_first_world = kept_.front().T_first_lidar * poses.front().Inverse();
  motion_.StartOver();
  for (std::size_t k = 0; k < kept_.size(); ++k) {
    kept_[k].T_first_lidar = T_first_world * poses[k];
    motion_.Accept(kept_[k].stamp_ns, kept_[k].T_first_lidar, k > 0);
    if (k == 0) continue;
    if (k == 1) kept_[0].clusters = DeskewClusters(kept_[0].timed, motion_.velocity());
    kept_[k].clusters = DeskewClusters(kept_[k].timed, motion_.velocity());
  }
  return true;
}

Vector6d LostTrack::Twist() const { return motion_.velocity(); }

std::vector<PointCluster> LostTrack::Together() const {
  std::vector<TimedCluster> all;
  for (const Scan& scan : kept_) {
    const SE3 T_newest_lidar = T_first_newest().Inverse() * scan.T_first_lidar;
    for (const PointCluster& cluster : scan.clusters) {
      all.emplace_back();
      all.back().points = cluster.Moved(T_newest_lidar);
    }
  }
  if (kept_.size() > 1) all = MergeClusters(all, map_options_.LeafSize());
  return DeskewClusters(all, SweepMotion());
}

void LostTrack::Archive(StateArchive& a) {
  a(&motion_, &scans_, &first_stamp_ns_, &T_world_first_guess_, &guesses_);
  kept_.resize(a.Size(kept_.size(), 1));
  for (Scan& scan : kept_) a(&scan.stamp_ns, &scan.T_first_lidar, &scan.timed, &scan.clusters);
}

}  // namespace lamina
