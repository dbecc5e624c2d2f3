#include "frontend/start/rest_at_start.h"

#include <algorithm>
#include <utility>

#include "frontend/odometry/odometry.h"

namespace lamina {

bool RestAtStart::SetsOff(const OdometryFrame& frame, bool stamp_made_up,
                          const std::vector<TimedCluster>& clusters, const RaysSeenAgain& rays) {
  if (over_) return false;
  const SE3& T = frame.T_world_lidar;
  if (!begun_) T_world_begin_ = T;
  begun_ = true;
  if (rays.pairs() > 0) repeated_ = rays.Repeated();
  const bool moved = rested_ > 0 && ((T.t - T_world_rest_.t).norm() > kRestsM ||
                                     RotationAngle(T_world_rest_, T) > kRestsRad);
  const bool far = (T.t - T_world_begin_.t).norm() > kStartM;
  const bool gap =
      rested_ > 0 && SecondsBetween(kept_.back().stamp_ns, frame.stamp_ns) > kMostFollowingGapS;
  if (frame.status == OdometryFrame::Status::kLost || (far && !rested()) ||
      (moved && rested() && !repeated_)) {
    End();
    return false;
  }
  const bool asked = repeated_ && rays.pairs() > 0;
  const bool less = asked && rays.Agree() < LeastAgreed() - less_;
  if (rested() && !gap && (moved || less)) {
    over_ = true;
    by_rays_ = !moved;
    return true;
  }
  if (gap || moved || (rested_ > 0 && !rested() && !rays.Rests())) Forget();
  if (rested_ == 0) T_world_rest_ = T;
  if (asked && rested_ > 0) Agreed(rays.Agree());
  ++rested_;
  if (kept_.size() >= kKept) kept_.erase(kept_.begin());
  kept_.push_back({frame.stamp_ns, stamp_made_up, clusters});
  return false;
}

void RestAtStart::Forget() {
  rested_ = 0;
  newest_agreed_.clear();
  least_agreed_ = least_before_ = 1.0;
  in_block_ = 0;
  kept_.clear();
}

double RestAtStart::LeastAgreed() const {
  return newest_agreed_.empty() ? 0.0
                                : std::min({least_before_, least_agreed_, newest_agreed_.front()});
}

void RestAtStart::Agreed(double share) {
  // A slow start may stay unnoticed for kNewest scans, and must not lower the minimum meanwhile.
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
  if (over_ && !rests) return End();
  RestAtStart next;
  next.less_ = over_ && by_rays_ ? 2.0 * less_ : less_;
  if (!rests) {
    next.begun_ = begun_;
    next.T_world_begin_ = T_world_begin_;
  }
  *this = std::move(next);
}

void RestAtStart::Move(const SE3& correction) {
  T_world_begin_ = correction * T_world_begin_;
  T_world_rest_ = correction * T_world_rest_;
}

void RestAtStart::Archive(StateArchive& a) {
  a(&over_, &begun_, &repeated_, &by_rays_, &rested_, &less_, &newest_agreed_, &least_agreed_,
    &least_before_, &in_block_, &T_world_begin_, &T_world_rest_, &kept_);
}

}  // namespace lamina
