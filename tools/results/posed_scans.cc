#include "tools/results/posed_scans.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/geometry/sweep_motion.h"
#include "tools/metrics/trajectory_metrics.h"

namespace lamina {
namespace {

Vector6d TwistAround(const Trajectory& poses, std::size_t i) {
  Vector6d sum = Vector6d::Zero();
  int terms = 0;
  for (std::size_t k = i == 0 ? 1 : i; k < std::min(i + 2, poses.size()); ++k) {
    const double dt = SecondsBetween(poses[k - 1].stamp_ns, poses[k].stamp_ns);
    if (dt <= 0.0) continue;
    sum += MeanTwist(poses[k - 1].T_world_lidar, poses[k].T_world_lidar, dt);
    ++terms;
  }
  return terms > 0 ? Vector6d(sum / terms) : sum;
}

std::vector<StampNs> StampsAround(const ScanSource& scans, size_t i) {
  constexpr size_t kBefore = 9;
  std::vector<StampNs> stamps = scans.StampsUpTo(i, 0, kBefore + 1);
  for (size_t k = i + 1; k < scans.size() && stamps.size() <= kBefore; ++k) {
    if (scans.Sensor(k) == scans.Sensor(i)) stamps.push_back(scans.Stamp(k));
  }
  return stamps;
}

}  // namespace

std::vector<StampNs> ScanStamps(const ScanSource& scans) {
  std::vector<StampNs> stamps(scans.size());
  for (size_t i = 0; i < stamps.size(); ++i) stamps[i] = scans.Stamp(i);
  return stamps;
}

std::vector<PosedScan> PoseScans(const ScanSource& scans, const Trajectory& trajectory,
                                 double tolerance_s) {
  std::vector<std::pair<StampNs, size_t>> by_stamp(scans.size());
  for (size_t i = 0; i < by_stamp.size(); ++i) by_stamp[i] = {scans.Stamp(i), i};
  std::sort(by_stamp.begin(), by_stamp.end());
  // Of scans with one stamp only the first was usable to the maker of the trajectory.
  by_stamp.erase(std::unique(by_stamp.begin(), by_stamp.end(),
                             [](const auto& a, const auto& b) { return a.first == b.first; }),
                 by_stamp.end());
  Trajectory wanted;
  for (const auto& [stamp, index] : by_stamp) wanted.push_back({stamp, SE3()});
  Trajectory poses = trajectory;
  MatchByStamp(tolerance_s, &poses, &wanted);
  constexpr double kAnyGapS = std::numeric_limits<double>::infinity();
  std::vector<PosedScan> posed(poses.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    const auto scan = std::lower_bound(by_stamp.begin(), by_stamp.end(),
                                       std::make_pair(wanted[i].stamp_ns, size_t{0}));
    posed[i] = {scan->second, poses[i].T_world_lidar, SweepMotion(), TwistAround(poses, i)};
    MotionThrough(poses, i, kAnyGapS, &posed[i].sweep);
  }
  return posed;
}

double SweepPeriodOfScan(const ScanSource& scans, size_t i, double fallback_s) {
  return SweepPeriod(StampsAround(scans, i), fallback_s);
}

double TimeBetweenScans(const ScanSource& scans, size_t i, double fallback_s) {
  return TimeBetween(StampsAround(scans, i)).value_or(fallback_s);
}

SweepDeskew::SweepDeskew(const SweepMotion& sweep)
    : sweep_(sweep),
      steady_(sweep.acceleration.isZero()),
      rate_(sweep.twist.head<3>().norm()),
      axis_(Eigen::Vector3d::Zero()),
      velocity_(sweep.twist.tail<3>()),
      bent_once_(Eigen::Vector3d::Zero()),
      bent_twice_(Eigen::Vector3d::Zero()) {
  if (rate_ < 1e-12) return;
  axis_ = sweep.twist.head<3>() / rate_;
  bent_once_ = axis_.cross(velocity_) / rate_;
  bent_twice_ = axis_.cross(axis_.cross(velocity_)) / rate_;
}

Eigen::Vector3d SweepDeskew::operator()(const TimedPoint& p) const {
  const Eigen::Vector3d x(p.x, p.y, p.z);
  return steady_ ? Steady(x, p.time_s) : sweep_.PoseAt(p.time_s) * x;
}

Eigen::Vector3d SweepDeskew::Steady(const Eigen::Vector3d& x, double tau) const {
  const double angle = rate_ * tau;
  const double sine = std::sin(angle);
  const double half = std::sin(0.5 * angle);
  const double versine = 2.0 * half * half;  // 1 - cos, without its cancellation
  const Eigen::Vector3d turned = axis_.cross(x);
  return x + tau * velocity_ + sine * turned + versine * (axis_.cross(turned) + bent_once_) +
         (angle - sine) * bent_twice_;
}

}  // namespace lamina
