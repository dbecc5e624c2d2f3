// Odometry where few surfaces face the direction that a match knows least.
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/thinning.h"
#include "core/geometry/degeneracy.h"
#include "frontend/matching/direction_profile.h"
#include "frontend/odometry/odometry.h"

namespace lamina {
namespace {

// A direction that is known better than this, or faced by more blocks, has no second minimum near
// the first.
constexpr double kWellKnownM = 0.003, kManyBlocks = 20.0;

// Below this sigma generated scenes showed no wrong minimum, except with few points or without
// recorded stamps.
constexpr double kDoubtfulM = 0.006;

// Range in which minima beside a match are looked for; a search would have found farther ones.
constexpr double kBesideM = 0.5;

// Whether a step along a direction turns the sensor about an axis near by. A wrong minimum lies
// beside the right one where all that faces the direction meets other surfaces at once. Under a
// translation everything moves by the same distance, and each of a row of like things meets the
// next; under a rotation about an axis near by, near and far surfaces move by different distances.
bool TurnsNearby(const Vector6d& direction) {
  constexpr double kNearM = 10.0;
  return kRotationArmM * direction.tail<3>().norm() < kNearM * direction.head<3>().norm();
}

// Clusters that suffice to tell two motions apart, which differ for all clusters.
constexpr std::size_t kEnoughClusters = 4000;

// A prediction that is less certain than this does not choose among minima.
constexpr double kSteadyM = 0.12;

// The posterior prefers another minimum beyond this many standard deviations from the match.
constexpr double kElsewhereSigmas = 3.0;

// Standard deviation of a prediction along a unit vector of the scaled tangent.
double OpenM(const PosePrediction& prediction, const Vector6d& direction) {
  return 1.0 / std::sqrt(prediction.Information(direction));
}

// Whether the votes of blocks contradict a match: near and dense objects that move along hold it
// against the static world. In scenes without such objects the step is some millimetres. While no
// motion is known a lower threshold applies, since nothing else contradicts them.
bool IsDivided(const MatchResult& match, bool moving_known) {
  constexpr double kLeastM = 0.03, kSigmas = 2.5, kStartSigmas = 2.0;
  return match.block_step.step_m.norm() > kLeastM &&
         match.block_step.sigmas > (moving_known ? kSigmas : kStartSigmas);
}

// By how much a sensor that is shaken like the last scan may deviate from its mean velocity in the
// next gap, along a unit vector of the scaled tangent: it may have reversed meanwhile.
double SwayM(const UnsteadyMotion& last, double gap_s, const Vector6d& v) {
  const Vector6d off =
      TimesArm(Vector6d(2.0 * gap_s * gap_s * (last.tail<6>() + 0.5 * last.head<6>())));
  return off.head<3>().norm() * v.head<3>().norm() + off.tail<3>().norm() * v.tail<3>().norm();
}

// Standard deviation along a unit vector of the scaled tangent, of a covariance that is not scaled.
double SigmaAlong(const Matrix6d& covariance, const Vector6d& v) {
  return std::sqrt(std::max(0.0, v.dot(TimesArm(covariance) * v)));
}

// Adds this uncertainty along a direction of the scaled tangent.
void Widen(double sigma_m, const Vector6d& direction, MatchResult* match) {
  const Vector6d along = DividedByArm(Vector6d(sigma_m * direction));
  match->covariance += along * along.transpose();
}

}  // namespace

void Odometry::SettleWeakest(Attempt* attempt) const {
  const PosePrediction& prediction = attempt->prediction;
  OdometryFrame* const frame = &attempt->frame;
  const double dt = motion_.Gap(frame->stamp_ns);
  const MatchResult& match = frame->match;
  // Objects that set off together with the sensor constrain it as well as static ones, until the
  // distance since the last scan separates the two.
  const double way_m = (match.T_world_lidar.t - motion_.T_world_last().t).norm();
  const bool setting_off = recent_inliers_.size() < kRecentScans && way_m < kBesideM;
  const bool divided = IsDivided(match, motion_.moving_known());
  if (match.status == MatchResult::Status::kTooFewMatches || lost_ ||
      (!setting_off && !divided && match.worst_sigma_m < kWellKnownM) || dt <= 0.0 ||
      (dt > options_.vouched_gap_s && Unbridged(prediction, match)))
    return;
  const Vector6d v =
      divided ? StraightAlong(match.block_step.step_m.normalized()) : match.weakest_direction;
  const Vector6d off = ScaledDelta(match.T_world_lidar, prediction.T_world_lidar);
  const double doubtful_m = options_.matcher.max_direction_sigma_m;
  const bool open = Unbridged(prediction, match);
  if (open && std::abs(v.dot(off)) < doubtful_m) return;  // as expected, however unsure that is
  const double sigma_m =
      std::hypot(OpenM(prediction, v), SigmaAlong(motion_.Drift(frame->stamp_ns), v));
  const bool expected = motion_.moving_known() && sigma_m < kBesideM;
  if (expected && !divided && match.degenerate == 0 && TurnsNearby(v)) return;
  const std::vector<PointCluster> some =
      setting_off ? Thinned(attempt->deskewed, kEnoughClusters) : std::vector<PointCluster>();
  const DirectionProfile profile(setting_off ? some : attempt->deskewed, attempt->map,
                                 match.T_world_lidar, v);
  if (!setting_off && !divided && profile.Blocks() > kManyBlocks) return;
  // Where the last pose was uncertain, so is the map that its scan made, and a profile against that
  // map cannot correct this pose.
  if (!motion_.moving_known() || (!open && sigma_m > kSteadyM)) {
    DoubtWeakest(profile, v, frame);
    return;
  }
  const DirectionProfile::Posterior posterior = profile.With(v.dot(off), sigma_m);
  // If the prediction does not choose, the profile of the surfaces shows minima that the descent
  // has passed by.
  if (open &&
      std::abs(posterior.mean_m) <= std::max(doubtful_m, kElsewhereSigmas * posterior.sigma_m))
    return;
  const SE3 T = profile.At(posterior.mean_m);
  if (attempt->passes > 0) attempt->Deskew(SweepAt(T, *frame));
  frame->match =
      matcher_.MatchKnown(attempt->deskewed, T, {v, posterior.sigma_m}, prediction, attempt->map);
  DoubtContradicted(profile, posterior.mean_m, v, frame);
  // The rest of the information along v is that of planes.
  const double known = 1.0 / (posterior.sigma_m * posterior.sigma_m);
  const double predicted = std::min(known, 1.0 / (sigma_m * sigma_m));
  frame->match.prior_information += (predicted - known) * v * v.transpose();
}

void Odometry::DoubtContradicted(const DirectionProfile& profile, double settled_m,
                                 const Vector6d& direction, OdometryFrame* frame) const {
  constexpr double kSigmas = 6.0, kLeastM = 0.25;
  const DirectionProfile::Posterior alone = profile.With(0.0, kBesideM);
  const double off_m = std::abs(alone.mean_m - settled_m);
  if (off_m < std::max(kLeastM, kSigmas * alone.sigma_m)) return;
  Widen(off_m, direction, &frame->match);
  frame->match.MakeDegenerate(direction);
}

bool Odometry::Unbridged(const PosePrediction& prediction, const MatchResult& match) const {
  return motion_.moving_known() && OpenM(prediction, match.weakest_direction) > kSteadyM;
}

void Odometry::DoubtUnbridged(const PosePrediction& prediction,
                              const std::vector<PointCluster>& deskewed, const VoxelMap& map,
                              OdometryFrame* frame) const {
  const MatchResult& match = frame->match;
  if (frame->status != OdometryFrame::Status::kTracked || !Unbridged(prediction, match)) return;
  constexpr double kLeastS = 1e-3;
  const double dt = std::max(kLeastS, motion_.Gap(frame->stamp_ns));
  bool vouched = dt <= options_.vouched_gap_s;
  if (motion_.uneven()) {
    const double open_m = dt * SigmaAlong(motion_.VelocityChange(dt), match.weakest_direction);
    vouched = open_m <= kSteadyM;
    if (!vouched && match.degenerate > 0) {
      // No stamp tells how far the sensor has come, and the few surfaces that do may be wrong
      // together.
      Widen(open_m, match.weakest_direction, &frame->match);
      return;
    }
  }
  if (vouched || match.worst_sigma_m < kWellKnownM) return;
  const DirectionProfile profile(deskewed, map, match.T_world_lidar, match.weakest_direction);
  if (profile.Blocks() <= kManyBlocks) {
    DoubtWeakest(profile, match.weakest_direction, frame);
  }
}

void Odometry::DoubtWeakest(const DirectionProfile& profile, const Vector6d& direction,
                            OdometryFrame* frame) const {
  MatchResult* const match = &frame->match;
  const double least_m = motion_.stamps_recorded() ? kDoubtfulM : kWellKnownM;
  const DirectionProfile::Posterior posterior = profile.With(0.0, kBesideM);
  const double sigma_m = std::hypot(posterior.sigma_m, posterior.mean_m);
  frame->open_m = sigma_m;
  Widen(sigma_m, direction, match);
  const bool doubtful = match->worst_sigma_m > least_m || IsDivided(*match, motion_.moving_known());
  if (sigma_m > options_.matcher.max_direction_sigma_m && doubtful)
    match->MakeDegenerate(direction);
}

void Odometry::DoubtSurprising(const PosePrediction& prediction, OdometryFrame* frame) const {
  MatchResult* const match = &frame->match;
  const double dt = motion_.Gap(frame->stamp_ns);
  if (frame->status != OdometryFrame::Status::kTracked || lost_ || !motion_.moving_known() ||
      !motion_.stamps_recorded() || dt > options_.vouched_gap_s ||
      match->worst_sigma_m <= kDoubtfulM)
    return;
  const Vector6d v = match->weakest_direction;
  const Vector6d off = ScaledDelta(match->T_world_lidar, prediction.T_world_lidar);
  const double off_m = std::abs(v.dot(off));
  const double sigma_m = SigmaAlong(prediction.covariance + match->covariance, v);
  const double usual_m = std::max(kLeastSurpriseM, SwayM(last_shake_, dt, v));
  if (off_m <= std::max(usual_m, options_.max_prediction_sigmas * sigma_m)) return;
  frame->surprise_m = off_m;
  Widen(off_m, v, match);
  match->MakeDegenerate(v);
}

}  // namespace lamina
