#include "backend/pieces/ambiguous_place.h"

#include <algorithm>
#include <cmath>

#include "backend/pieces/older_planes.h"
#include "core/base/angle.h"
#include "core/geometry/robust_kernel.h"
#include "frontend/matching/plane_score.h"

namespace lamina {
namespace {

// U (CauchyCost) of a turn against the predicted one over a gap, which turned the sensor at some
// rate, however it began.
double TurnUnlikeliness(const SE3& T_predicted, const SE3& T, double gap_s) {
  constexpr double kRateDegS = 60.0;
  return CauchyCost(std::pow(RotationAngle(T_predicted, T) / (Radians(kRateDegS) * gap_s), 2));
}

}  // namespace

void AmbiguousPlace::Follow(const OdometryFrame& frame, const MotionModel& motion,
                            const std::vector<TimedCluster>& clusters, const VoxelMap& map,
                            const SlidingWindow& window, std::int64_t next_keyframe) {
  constexpr double kClearSigmas = 2.5, kLeastGapS = 0.1;
  if (frame.status != OdometryFrame::Status::kTracked) return;
  const bool ambiguous = !frame.elsewhere.isZero();
  // The second scan of a map may be matched to objects that move along with the sensor, and so may
  // all that follow it: no piece is to begin with these.
  if (!open_ && ambiguous && !before_ && motion.moving_known()) {
    open_ = true;
    scans_ = 0;
    first_keyframe_ = next_keyframe;
    const SE3& T = frame.T_world_lidar;
    const SE3 T_other = Retract(T, frame.elsewhere);
    T_other_ours_ = T_other * T.Inverse();
    const double gap_s = std::max(kLeastGapS, motion.Gap(frame.stamp_ns));
    likelier_ = TurnUnlikeliness(frame.T_world_predicted, T_other, gap_s) -
                TurnUnlikeliness(frame.T_world_predicted, T, gap_s);
  }
  before_ = ambiguous;
  if (!open_) return;
  const double clear = ClearSquared(Sigmas(frame, clusters, map, window), likelier_);
  ++scans_;
  if (clear > kClearSigmas * kClearSigmas) Forget();
  if (clear < -kClearSigmas * kClearSigmas) scans_ = kMostScans;
}

double AmbiguousPlace::Sigmas(const OdometryFrame& frame, const std::vector<TimedCluster>& clusters,
                              const VoxelMap& map, const SlidingWindow& window) const {
  constexpr double kScaleM = 0.3;
  OlderPlanes older(map, window, first_keyframe_);
  PlaceVotes votes(map, kScaleM, [&](VoxelMap::NodeId surface) { return older.Of(surface); });
  const auto add = [&](const std::vector<PointCluster>& deskewed, const SE3& T) {
    votes.Add(deskewed, T, T_other_ours_ * T, T);
  };
  for (const WindowFrame& since : window.frames()) {
    if (since.id >= first_keyframe_) add(since.deskewed, since.T_world_lidar);
  }
  add(DeskewClusters(clusters, frame.sweep), frame.T_world_lidar);
  return votes.Sigmas();
}

void AmbiguousPlace::Widen(MatchResult* match) const {
  if (!open_) return;
  match->MayBeElsewhere(LocalDelta(match->T_world_lidar, T_other_ours_ * match->T_world_lidar));
}

void AmbiguousPlace::Archive(StateArchive& a) {
  a(&open_, &before_, &scans_, &first_keyframe_, &T_other_ours_, &likelier_);
}

}  // namespace lamina
