#include "frontend/start/resting_beams.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/angle.h"
#include "core/base/median.h"
#include "core/geometry/robust_kernel.h"
#include "frontend/scan/scan_clusters.h"
#include "frontend/start/beam_agreement.h"

namespace lamina {
namespace {

// Mean weight from which on rays agree as at rest, in the noise that they show.
constexpr double kRests = 0.77;

// Mean weight in [0, 1] of differences of ranges, in the noise that the smallest quarter of them
// shows, which may be larger than `noise_m`.
double AsNoise(const std::vector<double>& off_m, double noise_m) {
  constexpr double kQuarterSigmas = 0.3186;  // a quarter of normal deviates is smaller
  if (off_m.empty()) return 1.0;
  std::vector<double> sizes;
  for (const double off : off_m) sizes.push_back(std::abs(off));
  const double sigma_m = std::max(noise_m, Quantile(&sizes, 0.25) / kQuarterSigmas);
  double sum = 0.0;
  for (const double off : off_m)
    sum += GemanMcClureWeight(std::pow(off / (kRangeSigmas * sigma_m), 2));
  return sum / static_cast<double>(off_m.size());
}

}  // namespace

void RaysSeenAgain::Add(const std::vector<PointCluster>& before,
                        const std::vector<PointCluster>& clusters, const SE3& T_before_this) {
  constexpr double kTurnedRad = Radians(0.2), kRestsM = 0.04;
  constexpr double kAgree = 0.5, kAgreeLessPerM = 2.5, kNoStepM = 0.005;
  const double step_m = T_before_this.t.norm();
  if (RotationAngle(SE3(), T_before_this) > kTurnedRad || step_m > kRestsM) return;
  const BeamAgreement beams(before, kRangeSigmas * noise_m_);
  const BeamAgreement::Shares shares = beams.At(clusters, T_before_this);
  // Rings on the ground move along with the sensor, so that rays are also compared without the
  // step.
  const SE3 T_turned(T_before_this.q, Eigen::Vector3d::Zero());
  const double agree =
      step_m < kNoStepM ? shares.agree : std::max(shares.agree, beams.Of(clusters, T_turned));
  const double least = kAgree - kAgreeLessPerM * step_m;
  // In the noise that is known they agree to no more than in the one that they show.
  const double in_noise =
      agree >= kRests ? agree : AsNoise(beams.RangesOff(clusters, T_turned), noise_m_);
  pairs_.push_back({shares.beside, agree, least, in_noise});
}

template <typename Of>
double RaysSeenAgain::Mean(const Of& of) const {
  double sum = 0.0;
  for (const Pair& pair : pairs_) sum += of(pair);
  return sum / static_cast<double>(pairs_.size());
}

double RaysSeenAgain::Agree() const {
  return Mean([](const Pair& pair) { return pair.agree; });
}

bool RaysSeenAgain::Repeated() const {
  constexpr double kRepeated = 0.5;
  return !pairs_.empty() && Mean([](const Pair& pair) { return pair.repeated; }) >= kRepeated;
}

bool RaysSeenAgain::Rests() const {
  return Repeated() && Mean([](const Pair& pair) { return pair.in_noise; }) >= kRests;
}

bool RaysSeenAgain::Contradict() const {
  // Noise alone gives a mean weight of 0.8; below 0.72 the ranges disagree.
  constexpr double kAsNoise = 0.72;
  if (!Repeated() || Agree() >= Mean([](const Pair& pair) { return pair.least; })) return false;
  return Mean([](const Pair& pair) { return pair.agree < pair.least ? pair.in_noise : 1.0; }) <
         kAsNoise;
}

void RestingBeams::Add(const std::vector<TimedCluster>& clusters, const SE3& T_world_lidar) {
  // A sensor that moves farther than this from scan to scan does not come to rest in the next one.
  constexpr double kSlowM = 0.5;
  constexpr int kDoubted = 10;
  const SE3 T_last_this = T_world_last_.Inverse() * T_world_lidar;
  const bool slow = last_.empty() || T_last_this.t.norm() < kSlowM;
  newest_ = RaysSeenAgain(noise_m_);
  std::vector<PointCluster> points = slow ? Undeskewed(clusters) : std::vector<PointCluster>();
  if (!last_.empty()) newest_.Add(last_, points, T_last_this);
  if (newest_.Contradict()) {
    ++contradictions_;
    doubted_ = kDoubted;
  } else {
    doubted_ = newest_.pairs() == 0 && slow ? std::max(0, doubted_ - 1) : 0;
    if (doubted_ == 0) contradictions_ = 0;
  }
  last_ = std::move(points);
  T_world_last_ = T_world_lidar;
}

}  // namespace lamina
