#include "core/geometry/central_twist.h"

namespace lamina {

bool CentralTwist(const Trajectory& poses, std::size_t i, double max_gap_s, Vector6d* twist) {
  Vector6d sum = Vector6d::Zero();
  int terms = 0;
  const auto add = [&](const StampedPose& a, const StampedPose& b) {
    const double dt = SecondsBetween(a.stamp_ns, b.stamp_ns);
    if (dt <= 0.0 || dt > max_gap_s) return;
    sum += TwistLog(a.T_world_lidar.Inverse() * b.T_world_lidar) / dt;
    ++terms;
  };
  if (i > 0) add(poses[i - 1], poses[i]);
  if (i + 1 < poses.size()) add(poses[i], poses[i + 1]);
  if (terms > 0) *twist = sum / terms;
  return terms > 0;
}

}  // namespace lamina
