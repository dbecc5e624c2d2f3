#include "frontend/start/resting_beams.h"

#include "core/base/angle.h"
#include "frontend/scan/scan_clusters.h"
#include "frontend/start/beam_agreement.h"

namespace lamina {

void RaysSeenAgain::Add(const std::vector<TimedCluster>& before,
                        const std::vector<TimedCluster>& clusters, const SE3& T_before_this) {
  constexpr double kTurnedRad = Radians(0.2);
  if (RotationAngle(SE3(), T_before_this) > kTurnedRad) return;
  const Vector6d rest = Vector6d::Zero();
  const BeamAgreement beams(DeskewClusters(before, rest), kRangeSigmas * noise_m_);
  const std::vector<PointCluster> now = DeskewClusters(clusters, rest);
  repeated_ += beams.Beside(now, T_before_this);
  agree_ += beams.Of(now, T_before_this);
  ++pairs_;
}

bool RaysSeenAgain::Contradict() const {
  constexpr double kRepeated = 0.5, kAgree = 0.5;
  const double pairs = static_cast<double>(pairs_);
  return pairs_ > 0 && repeated_ >= kRepeated * pairs && agree_ < kAgree * pairs;
}

bool RestingBeams::Contradict(const std::vector<TimedCluster>& clusters, const SE3& T_world_lidar) {
  // Rays that are farther apart have met other things, and a sensor that has gone so far does not
  // come to rest in the next scan.
  constexpr double kRestsM = 0.08, kSlowM = 0.5;
  bool contradict = false;
  const SE3 T_last_this = T_world_last_.Inverse() * T_world_lidar;
  const double step_m = T_last_this.t.norm();
  if (!last_.empty() && step_m < kRestsM) {
    RaysSeenAgain rays(noise_m_);
    rays.Add(last_, clusters, T_last_this);
    contradict = rays.Contradict();
  }
  if (last_.empty() || step_m < kSlowM) {
    last_ = clusters;
  } else {
    last_.clear();
  }
  T_world_last_ = T_world_lidar;
  in_a_row_ = contradict ? in_a_row_ + 1 : 0;
  return contradict;
}

}  // namespace lamina
