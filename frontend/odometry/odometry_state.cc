// What Odometry keeps from one scan to the next.
#include "frontend/odometry/odometry.h"

namespace lamina {

void Odometry::Accept(const OdometryFrame& frame) {
  const bool tracked = frame.status == OdometryFrame::Status::kTracked;
  // The first scan of a map follows another one where the motion is known from elsewhere.
  const bool follows = tracked || (frame.status == OdometryFrame::Status::kFirst && started());
  if (tracked) {
    last_shake_.setZero();
    if (frame.sweep.of_scan)
      last_shake_ = UnsteadyPart(frame.sweep, motion_.T_world_last(), frame.T_world_lidar,
                                 motion_.Gap(frame.stamp_ns));
  }
  motion_.Accept(frame.stamp_ns, frame.T_world_lidar, follows, frame.match.covariance);
  if (!follows) accelerations_ = RecentAccelerations(options_.motion);
  if (!frame.acceleration.covariance.isZero()) accelerations_.Add(frame.acceleration);
  lost_ = false;
  elsewhere_ = frame.elsewhere;
  if (tracked) {
    recent_inliers_.push_back(frame.match.inlier_share);
    recent_fits_.push_back(frame.match.fit());
    if (recent_inliers_.size() > kRecentScans) recent_inliers_.pop_front();
    if (recent_fits_.size() > kRecentScans) recent_fits_.pop_front();
  } else {
    recent_inliers_.clear();
    recent_fits_.clear();
  }
}

void Odometry::StartOver() {
  motion_.StartOver();
  accelerations_ = RecentAccelerations(options_.motion);
  recent_inliers_.clear();
  recent_fits_.clear();
  elsewhere_.setZero();
  last_shake_.setZero();
  lost_ = false;
}

void Odometry::Accept(StampNs stamp_ns, const SE3& T_world_lidar) {
  motion_.Accept(stamp_ns, T_world_lidar, motion_.started(), Matrix6d::Zero());
}

void Odometry::GoOnFrom(const Odometry& before) {
  motion_ = before.motion_;
  accelerations_ = before.accelerations_;
  recent_inliers_ = before.recent_inliers_;
  recent_fits_ = before.recent_fits_;
  last_shake_ = before.last_shake_;
}

void Odometry::StartAt(const SE3& T_world_lidar) {
  StartOver();
  motion_.StartAt(T_world_lidar);
}

void Odometry::Archive(StateArchive& a) {
  a(&motion_, &accelerations_, &recent_inliers_, &recent_fits_, &lost_, &elsewhere_, &last_shake_);
}

}  // namespace lamina
