#include "tools/results/verdict/rules.h"

#include <algorithm>
#include <cmath>

#include "core/base/angle.h"

namespace lamina::run_rules {
namespace {

// Of the change of a velocity over dt_s, where two positions that err by `error` may feign one.
double Acceleration(double change, double dt_s, double error) {
  return std::max(0.0, change * dt_s - error) / (dt_s * dt_s);
}

}  // namespace

double Overlap(const ScanRecord& scan) {
  return scan.clusters > 0 ? static_cast<double>(scan.matched) / static_cast<double>(scan.clusters)
                           : 0.0;
}

double Fit(const ScanRecord& scan) {
  return scan.matched > 0 ? scan.inlier_share * static_cast<double>(scan.clusters) /
                                static_cast<double>(scan.matched)
                          : 0.0;
}

std::optional<MotionChange> ChangeOfMotion(const StampedPose& first, const StampedPose& second,
                                           const StampedPose& third) {
  const double before_s = SecondsBetween(first.stamp_ns, second.stamp_ns);
  const double after_s = SecondsBetween(second.stamp_ns, third.stamp_ns);
  if (before_s <= 0.0 || after_s <= 0.0) return std::nullopt;
  const auto velocity = [](const SE3& a, const SE3& b, double dt_s) -> Eigen::Vector3d {
    return (b.t - a.t) / dt_s;
  };
  const auto turn = [](const SE3& a, const SE3& b, double dt_s) -> Eigen::Vector3d {
    return LogSO3(a.q.conjugate() * b.q) / (dt_s * kDegree);
  };
  const SE3 &a = first.T_world_lidar, &b = second.T_world_lidar, &c = third.T_world_lidar;
  const double dt_s = 0.5 * (before_s + after_s);
  return MotionChange{
      Acceleration((velocity(b, c, after_s) - velocity(a, b, before_s)).norm(), dt_s, kPoseErrorM),
      Acceleration((turn(b, c, after_s) - turn(a, b, before_s)).norm(), dt_s, kPoseErrorDeg)};
}

}  // namespace lamina::run_rules
