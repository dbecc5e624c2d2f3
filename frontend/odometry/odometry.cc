#include "frontend/odometry/odometry.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/angle.h"
#include "core/base/median.h"
#include "core/geometry/degeneracy.h"

namespace lamina {
namespace {

// 0 if there are none.
double MedianOf(const std::deque<double>& values) {
  std::vector<double> copy(values.begin(), values.end());
  return copy.empty() ? 0.0 : UpperMedian(&copy);
}

// Standard deviations of the prediction within which a lost sensor is looked for.
constexpr double kLikelySigmas = 2.0;

}  // namespace

void OdometryOptions::Visit(OptionVisitor& v) {
  v.Integer("deskew_passes", &deskew_passes, 0, 10);
  v.Number("lost_inlier_ratio", &lost_inlier_ratio, 0.0, 1.0);
  v.Number("doubtful_fit_ratio", &doubtful_fit_ratio, 0.0, 1.0);
  v.Number("max_prediction_sigmas", &max_prediction_sigmas, 0.5, 1e3);
  v.Number("vouched_gap_s", &vouched_gap_s, 0.0, 1e6);
  v.Number("max_sigma_m", &max_sigma_m, 0.001, 1e3);
  v.Number("max_tracked_sigma_m", &max_tracked_sigma_m, 0.001, 1e3);
  v.Group("motion", &motion);
  v.Group("matcher", &matcher);
  v.Group("search", &search);
}

Odometry::Odometry(const OdometryOptions& options)
    : options_(options),
      matcher_(options.matcher),
      narrow_matcher_(WithNarrowKernel(options.matcher)),
      search_(options.search, matcher_),
      motion_(options.motion),
      accelerations_(options.motion),
      shaken_(options.matcher, options.motion) {
  CheckOptions(options, "frontend");
}

OdometryFrame Odometry::Register(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                                 const VoxelMap& map, bool map_is_older) const {
  OdometryFrame frame;
  frame.stamp_ns = stamp_ns;
  if (!started()) return frame;
  const int passes = DeskewPasses(stamp_ns, clusters);
  frame = RegisterDeskewed(stamp_ns, clusters, map, map_is_older, passes);
  const bool deskewed_alone = passes > 0 && Starting(map_is_older) && !may_be_shaken_;
  if (!deskewed_alone || frame.status != OdometryFrame::Status::kLost) return frame;
  // The first scan is in the map undeskewed, as no motion was known. At speed a second one that is
  // deskewed does not fit it, where one that is undeskewed, and distorted alike, does.
  const OdometryFrame undeskewed = RegisterDeskewed(stamp_ns, clusters, map, map_is_older, 0);
  return undeskewed.status == OdometryFrame::Status::kTracked ? undeskewed : frame;
}

bool Odometry::Starting(bool map_is_older) const {
  return !lost_ && !map_is_older && !motion_.moving_known();
}

void Odometry::Attempt::Deskew(const SweepMotion& sweep) {
  frame.sweep = sweep;
  DeskewClusters(clusters, sweep, &deskewed);
}

Odometry::Attempt Odometry::Attempt::Anew(int deskew_passes) const {
  Attempt other{clusters, prediction, map, deskew_passes};
  other.frame.stamp_ns = frame.stamp_ns;
  other.frame.T_world_predicted = frame.T_world_predicted;
  other.frame.searched = true;
  return other;
}

void Odometry::Attempt::Take(Attempt&& other) {
  frame = other.frame;
  deskewed = std::move(other.deskewed);
}

OdometryFrame Odometry::RegisterDeskewed(StampNs stamp_ns,
                                         const std::vector<TimedCluster>& clusters,
                                         const VoxelMap& map, bool map_is_older, int passes) const {
  const PosePrediction prediction = motion_.Predict(stamp_ns);
  Attempt attempt{clusters, prediction, map, passes};
  OdometryFrame& frame = attempt.frame;
  const std::vector<PointCluster>& deskewed = attempt.deskewed;
  frame.stamp_ns = stamp_ns;
  frame.T_world_predicted = prediction.T_world_lidar;
  attempt.Deskew(motion_.Twist(stamp_ns));
  frame.match = passes > 0 ? matcher_.MatchPose(deskewed, prediction, map)
                           : matcher_.Match(deskewed, prediction, map);
  if (!lost_ && Surprising(frame.match, prediction)) SettleSurprise(&attempt);
  if (MayBeTurned(frame.match, prediction)) SettleTurn(&attempt);
  PoseHypotheses hypotheses;
  if (options_.search.enabled && (map_is_older || NeedsSearch(frame.match, prediction))) {
    hypotheses = Hypotheses(prediction, map_is_older);
    frame.searched = !hypotheses.empty();
  }
  SearchedScan scan{deskewed, prediction, map, Starting(map_is_older)};
  scan.timed = passes > 0;
  if (frame.searched) {
    frame.match = search_.Best(scan, &hypotheses, frame.match);
    if (passes == 0)
      frame.match = matcher_.Match(deskewed, prediction, frame.match.T_world_lidar, map);
  }
  MatchDeskewed(&attempt);
  if (passes > 0 && !lost_ && Surprising(frame.match, prediction)) SettleSweepSurprise(&attempt);
  Judge(scan, hypotheses, &frame);
  if (frame.status == OdometryFrame::Status::kLost && frame.searched) ReturnToPrediction(&attempt);
  if (frame.status == OdometryFrame::Status::kLost && frame.searched)
    FindTurn(hypotheses, &attempt);
  DoubtUnbridged(prediction, deskewed, map, &frame);
  DoubtSurprising(prediction, &frame);
  return frame;
}

SweepMotion Odometry::SweepTo(const SE3& T_world_lidar, const Vector6d& acceleration,
                              double dt) const {
  return SweepMotion::WithMean(motion_.TwistTo(T_world_lidar, dt), dt, acceleration);
}

int Odometry::DeskewPasses(StampNs stamp_ns, const std::vector<TimedCluster>& clusters) const {
  // The motion since a scan that was not over says little of the motion during this one: over so
  // short a gap errors of the poses dominate it.
  constexpr double kLeastSweeps = 0.3;
  if (!AnyTimed(clusters) || !motion_.TellsSweep(stamp_ns)) return 0;
  return motion_.Gap(stamp_ns) >= kLeastSweeps * SweepLength(clusters) ? options_.deskew_passes : 0;
}

void Odometry::MatchDeskewed(Attempt* attempt) const {
  OdometryFrame& frame = attempt->frame;
  const double dt = motion_.Gap(frame.stamp_ns);
  SweepAcceleration& unsteady = frame.acceleration;
  const SweepMotion before = frame.sweep;
  for (int pass = 0; pass < attempt->passes; ++pass) {
    attempt->Deskew(SweepTo(frame.match.T_world_lidar, Vector6d::Zero(), dt));
    if (motion_.moving_known()) {
      unsteady = EstimateAcceleration(options_.matcher, attempt->deskewed, attempt->clusters,
                                      frame.match, attempt->map, dt, accelerations_.Moment());
      frame.match.T_world_lidar = Retract(frame.match.T_world_lidar, unsteady.pose_step);
      attempt->Deskew(SweepTo(frame.match.T_world_lidar, unsteady.acceleration, dt));
    }
    frame.match = narrow_matcher_.Match(attempt->deskewed, attempt->prediction,
                                        frame.match.T_world_lidar, attempt->map);
  }
  if (attempt->passes > 0) MatchShaken(before, attempt);
  SettleWeakest(attempt);
  frame.match.covariance += unsteady.pose_covariance;
}

void Odometry::MatchShaken(const SweepMotion& before, Attempt* attempt) const {
  OdometryFrame& frame = attempt->frame;
  const bool starting = !motion_.moving_known();
  if (starting && !may_be_shaken_) return;
  const ShakenScan scan{
      attempt->clusters,           attempt->map, attempt->prediction,  motion_.T_world_last(),
      motion_.Gap(frame.stamp_ns), starting,     !last_shake_.isZero()};
  if (!before.of_scan && !shaken_.Suspected(scan, frame.match)) return;
  SweepMotion sweep = before.of_scan ? before : frame.sweep;
  Matrix6d pose_covariance;
  if (!shaken_.Find(scan, &attempt->deskewed, &frame.match, &sweep, &pose_covariance))
    return attempt->Deskew(frame.sweep);
  frame.sweep = sweep;
  frame.acceleration = SweepAcceleration();
  frame.acceleration.pose_covariance = pose_covariance;
}

bool Odometry::SeemsShaken(const OdometryFrame& frame) const {
  // Fit of a second scan: 0.80 and more in generated rooms by hand, below 0.45 for a car shaken at
  // 5 Hz.
  constexpr double kPoorFit = 0.7;
  return !motion_.moving_known() &&
         (frame.status == OdometryFrame::Status::kLost || frame.match.fit() < kPoorFit);
}

SweepMotion Odometry::SweepAt(const SE3& T_world_lidar, const OdometryFrame& frame) const {
  const double dt = motion_.Gap(frame.stamp_ns);
  if (!frame.sweep.of_scan) return SweepTo(T_world_lidar, frame.sweep.acceleration, dt);
  const SE3 T_last_world = motion_.T_world_last().Inverse();
  SweepMotion sweep = frame.sweep;
  sweep.twist += (TwistLog(T_last_world * T_world_lidar) -
                  TwistLog(T_last_world * frame.match.T_world_lidar)) /
                 dt;
  return sweep;
}

void Odometry::Rematch(const std::vector<TimedCluster>& clusters, const VoxelMap& map,
                       OdometryFrame* frame) const {
  const PosePrediction prediction = motion_.Predict(frame->stamp_ns);
  Attempt attempt{clusters, prediction, map, DeskewPasses(frame->stamp_ns, clusters), *frame};
  attempt.Deskew(frame->sweep);
  attempt.frame.match =
      matcher_.Match(attempt.deskewed, prediction, frame->match.T_world_lidar, map);
  MatchDeskewed(&attempt);
  *frame = attempt.frame;
  if (frame->match.status == MatchResult::Status::kTooFewMatches) {
    Reject(frame);
  } else {
    frame->T_world_lidar = frame->match.T_world_lidar;
  }
}

void Odometry::Judge(const SearchedScan& scan, const PoseHypotheses& hypotheses,
                     OdometryFrame* frame) const {
  frame->T_world_lidar = frame->match.T_world_lidar;
  frame->status = OdometryFrame::Status::kTracked;
  bool searched = false;
  // Without a search no rival is known: then a descent from the prediction must have been enough.
  const auto unique = [&] {
    searched = true;
    return options_.search.enabled ? search_.Unique(scan, hypotheses, frame->match)
                                   : WithinReach(scan.prediction);
  };
  if (Believed(*frame, scan, unique)) {
    frame->elsewhere = Elsewhere(scan, hypotheses, *frame, searched);
  } else {
    Reject(frame);
  }
}

void Odometry::Reject(OdometryFrame* frame) const {
  frame->status = OdometryFrame::Status::kLost;
  frame->T_world_lidar = frame->T_world_predicted;
  // What was found of the motion during the scan belongs to the match that is not believed.
  frame->sweep = motion_.Twist(frame->stamp_ns);
  frame->acceleration = SweepAcceleration();
  frame->match.covariance = motion_.Predict(frame->stamp_ns).covariance;
}

double Odometry::RecentInliers() const { return MedianOf(recent_inliers_); }

bool Odometry::StoodStill(const MatchResult& match) const {
  // The sensor may have moved on by the distance of one scan.
  constexpr double kStoodM = 0.5, kGoneOnS = 0.15, kStoodRad = 0.1, kStoodInliers = 0.9;
  const SE3& last = motion_.T_world_last();
  const double recent = RecentInliers();
  return recent > 0.0 && match.inlier_share >= kStoodInliers * recent &&
         (match.T_world_lidar.t - last.t).norm() <
             kStoodM + kGoneOnS * motion_.velocity().tail<3>().norm() &&
         RotationAngle(match.T_world_lidar, last) < kStoodRad;
}

bool Odometry::Searchable(const PosePrediction& prediction) const {
  return SigmaM(prediction) <= (motion_.moving_known() ? options_.search.max_way_m / kLikelySigmas
                                                       : options_.search.range_m);
}

bool Odometry::WithinReach(const PosePrediction& prediction) const {
  // Convergence radius of matching: about the width of planes.
  constexpr double kReachM = 0.5;
  return SigmaM(prediction) <= kReachM;
}

bool Odometry::AsExpected(const MatchResult& match, const PosePrediction& prediction) const {
  constexpr double kMostSigmaM = 1.0, kNearM = 0.5, kNearRad = 0.1, kLikeBefore = 0.9;
  return SigmaM(prediction) <= kMostSigmaM && match.status == MatchResult::Status::kConverged &&
         match.inlier_share >= kLikeBefore * RecentInliers() &&
         AreClose(match.T_world_lidar, prediction.T_world_lidar, kNearM, kNearRad);
}

bool Odometry::WhereMotionLeads(const MatchResult& match, const PosePrediction& prediction) {
  constexpr double kNearM = 0.3, kNearRad = 0.03;
  return AreClose(match.T_world_lidar, prediction.T_world_lidar, kNearM, kNearRad);
}

bool Odometry::Vouches(const MatchResult& match, const PosePrediction& prediction) const {
  if (motion_.moving_known()) return WithinReach(prediction) || AsExpected(match, prediction);
  // At a start a match near the prediction is likely, whatever the gap.
  return (match.T_world_lidar.t - prediction.T_world_lidar.t).norm() <= options_.search.range_m;
}

bool Odometry::NeedsSearch(const MatchResult& match, const PosePrediction& prediction) const {
  const PoseSearchOptions& o = options_.search;
  if (!lost_ && motion_.moving_known() && AsExpected(match, prediction)) return false;
  if (lost_ || !WithinReach(prediction)) return true;
  if (match.status == MatchResult::Status::kTooFewMatches) return true;
  if (Leaps(match, prediction)) return true;
  return match.inlier_share < o.trigger_inlier_ratio * RecentInliers();
}

bool Odometry::Leaps(const MatchResult& match, const PosePrediction& prediction) const {
  const SE3& a = prediction.T_world_lidar;
  const SE3& b = match.T_world_lidar;
  return RotationAngle(a, b) > Radians(options_.search.trigger_rotation_deg) ||
         (a.t - b.t).norm() > options_.search.trigger_translation_m;
}

PoseHypotheses Odometry::Hypotheses(const PosePrediction& prediction, bool map_is_older) const {
  const SE3 &centre = prediction.T_world_lidar, &last = motion_.T_world_last();
  // No speed is known at the first match in an older map, nor at the second.
  const bool starting = !motion_.moving_known() || (map_is_older && recent_inliers_.size() < 2);
  PoseHypotheses hypotheses;
  if (map_is_older && starting) {
    hypotheses.dense = OffsetsAbout(options_.search, centre);
    return hypotheses;
  }
  if (starting) return PoseHypotheses::Starting(options_.search, prediction, last);
  hypotheses = PoseHypotheses::GoingOn(options_.search, prediction, last);
  // If the uncertainty exceeds the predicted distance, the heading is unknown: search all headings.
  if (lost_ && (centre.t - last.t).norm() < SigmaM(prediction) && Searchable(prediction)) {
    for (const SE3& T : AllRound({centre, last})) {
      hypotheses.dense.push_back(T);
      hypotheses.coarse.push_back(T);
    }
  }
  return hypotheses;
}

bool Odometry::Believed(const OdometryFrame& frame, const SearchedScan& scan,
                        const std::function<bool()>& unique) const {
  const MatchResult& match = frame.match;
  const PosePrediction& prediction = scan.prediction;
  if (match.status == MatchResult::Status::kTooFewMatches) return false;
  const bool gap = lost_ || motion_.Gap(frame.stamp_ns) > options_.vouched_gap_s;
  const bool vouched = !gap && Vouches(match, prediction) &&
                       (!Leaps(match, prediction) ||
                        SigmasApart(prediction, match) <= options_.max_prediction_sigmas);
  const double recent = RecentInliers();
  if (match.inlier_share < options_.lost_inlier_ratio * recent) return false;
  // A match that fits no better than chance is rejected, whatever went before: also where the
  // prediction supports it, if so few clusters meet planes that the scan may be of another place.
  constexpr double kLeastFit = 0.65, kMeetsAll = 0.9, kMeetsFew = 0.4;
  const double recent_fit = MedianOf(recent_fits_);
  const double usual_fit = options_.doubtful_fit_ratio * recent_fit;
  if (match.inlier_share < kMeetsFew * recent && match.fit() < std::min(kLeastFit, usual_fit))
    return false;
  // At a start no fit is known to compare with: a second scan that fits the first one badly is of
  // another place. If stamps leave no time for that, planes of one scan of few rings may fit no
  // better: it is enough that no other pose near it fits as well.
  if (scan.starting && recent_fits_.empty() && !scan.timed && match.fit() < kLeastFit) {
    const bool follows = motion_.stamps_recorded() && !gap;
    return follows && match.fit() >= MatchResult::kFollowingFit &&
           match.status == MatchResult::Status::kConverged && unique();
  }
  // Without recorded stamps nearness to the prediction says little if the scan meets half of the
  // planes that scans did before.
  constexpr double kMeetsHalf = 0.5;
  const bool doubtful = match.fit() < usual_fit && match.inlier_share < kMeetsHalf * recent;
  if (vouched && (motion_.stamps_recorded() || !doubtful)) return true;
  if (match.status != MatchResult::Status::kConverged) return false;
  if (match.fit() < std::max(kLeastFit, usual_fit)) return false;
  // Of the many places where a lost scan may be, some fit by chance.
  constexpr double kFoundFit = 0.9;
  if (lost_ && !WithinReach(prediction) && !WhereMotionLeads(match, prediction) &&
      match.fit() < kFoundFit * recent_fit)
    return false;
  if (gap && !StoodStill(match)) {
    // Beyond the reach of the search there may be a better place, unless the scan after a gap meets
    // as much of the map as scans did before: where the sensor has not been, the map has less. One
    // that was lost may be anywhere, where another street meets as much.
    const bool meets_all = !lost_ && recent > 0.0 && match.inlier_share >= kMeetsAll * recent &&
                           SigmaM(prediction) <= options_.search.max_way_m;
    if ((lost_ || motion_.moving_known()) && !Searchable(prediction) && !meets_all) return false;
    if (SigmasApart(prediction, match) > kLikelySigmas) return false;
  }
  if (gap && WorstSigmaM(match.covariance) > options_.max_sigma_m) return false;
  return unique();
}

}  // namespace lamina
