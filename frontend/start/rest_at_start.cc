#include "frontend/start/rest_at_start.h"

#include <algorithm>
#include <utility>

#include "core/base/angle.h"
#include "frontend/odometry/odometry.h"

namespace lamina {

bool RestAtStart::SetsOff(const OdometryFrame& frame, bool stamp_made_up,
                          const std::vector<TimedCluster>& clusters, const RaysSeenAgain& rays) {
  constexpr double kRestsRad = Radians(0.4);
  constexpr int kLeastRested = 4;
  if (over_) return false;
  if (rays.pairs() > 0) repeated_ = rays.Repeated();
  if (rested_ == 0) T_world_first_ = frame.T_world_lidar;
  const bool moved = (frame.T_world_lidar.t - T_world_first_.t).norm() > kRestsM ||
                     RotationAngle(T_world_first_, frame.T_world_lidar) > kRestsRad;
  const bool long_rested = rested_ >= kLeastRested;
  const bool gap = rested_ > 0 && SecondsBetween(kept_.front().stamp_ns, frame.stamp_ns) >
                                      static_cast<double>(kept_.size()) * kMostStartGapS;
  if (frame.status == OdometryFrame::Status::kLost || gap ||
      (moved && (!long_rested || !repeated_)) || (rested_ > 0 && !long_rested && !rays.Rests())) {
    End();
    return false;
  }
  const bool asked = repeated_ && rays.pairs() > 0;
  if (moved || (long_rested && asked && rays.Agree() < LeastAgreed() - less_)) {
    over_ = true;
    return true;
  }
  ++rested_;
  if (asked) Agreed(rays.Agree());
  if (kept_.size() >= kKept) kept_.erase(kept_.begin());
  kept_.push_back({frame.stamp_ns, stamp_made_up, clusters});
  return false;
}

double RestAtStart::LeastAgreed() const {
  return newest_agreed_.empty() ? 0.0
                                : std::min({least_before_, least_agreed_, newest_agreed_.front()});
}

void RestAtStart::Agreed(double share) {
  // So long setting off may go on unnoticed.
  newest_agreed_.push_back(share);
  if (newest_agreed_.size() <= kNewest) return;
  least_agreed_ = std::min(least_agreed_, newest_agreed_.front());
  newest_agreed_.erase(newest_agreed_.begin());
  if (++in_block_ < kBlock) return;
  least_before_ = std::exchange(least_agreed_, 1.0);
  in_block_ = 0;
}

void RestAtStart::End() {
  over_ = true;
  kept_.clear();
}

void RestAtStart::GoOn(bool rests) {
  const double less = over_ && rested_ > 0 ? 2.0 * less_ : less_;
  *this = RestAtStart();
  less_ = less;
  if (!rests) End();
}

void RestAtStart::Archive(StateArchive& a) {
  a(&over_, &repeated_, &rested_, &less_, &newest_agreed_, &least_agreed_, &least_before_,
    &in_block_, &T_world_first_, &kept_);
}

}  // namespace lamina
