#include "core/geometry/sweep_motion.h"

namespace lamina {
namespace {

// Mean velocity from a to b, over the seconds *dt: 0 if none is to be had.
Vector6d Velocity(const StampedPose& a, const StampedPose& b, double max_gap_s, double* dt) {
  *dt = SecondsBetween(a.stamp_ns, b.stamp_ns);
  if (!(*dt > 0.0) || *dt > max_gap_s) *dt = 0.0;
  if (*dt == 0.0) return Vector6d::Zero();
  return TwistLog(a.T_world_lidar.Inverse() * b.T_world_lidar) / *dt;
}

}  // namespace

bool MotionThrough(const Trajectory& poses, std::size_t i, double max_gap_s, SweepMotion* motion) {
  if (motion->of_scan) return true;
  double before_s = 0.0, after_s = 0.0;
  Vector6d before = Vector6d::Zero(), after = Vector6d::Zero();
  if (i > 0) before = Velocity(poses[i - 1], poses[i], max_gap_s, &before_s);
  if (i + 1 < poses.size()) after = Velocity(poses[i], poses[i + 1], max_gap_s, &after_s);
  if (before_s == 0.0 && after_s == 0.0) return false;
  if (before_s == 0.0) {
    // The acceleration of the pose after it is nearer to the truth than none.
    SweepMotion next;
    if (i + 2 < poses.size() && MotionThrough(poses, i + 1, max_gap_s, &next))
      motion->acceleration = next.acceleration;
    *motion = SweepMotion::WithMean(after, -after_s, motion->acceleration);
  } else if (after_s == 0.0) {
    *motion = SweepMotion::WithMean(before, before_s, motion->acceleration);
  } else {
    const double both_s = before_s + after_s;
    *motion = {(after_s * before + before_s * after) / both_s, 2.0 * (after - before) / both_s};
  }
  return true;
}

SweepMotion FirstOfTwo(const Vector6d& mean, double seconds, const SweepMotion& first,
                       const SweepMotion& second) {
  const Vector6d change = second.acceleration - first.acceleration;
  SweepMotion motion(mean + 0.125 * seconds * change - 0.5 * (second.twist - first.twist),
                     -0.5 * change);
  motion.of_scan = true;
  return motion;
}

}  // namespace lamina
