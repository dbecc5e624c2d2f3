#include "core/geometry/sweep_motion.h"

#include <Eigen/LU>
#include <algorithm>
#include <vector>

namespace lamina {
namespace {

// Mean velocity from a to b, over the seconds *dt: 0 if none is to be had.
Vector6d Velocity(const StampedPose& a, const StampedPose& b, double max_gap_s, double* dt) {
  *dt = SecondsBetween(a.stamp_ns, b.stamp_ns);
  if (!(*dt > 0.0) || *dt > max_gap_s) *dt = 0.0;
  if (*dt == 0.0) return Vector6d::Zero();
  return MeanTwist(a.T_world_lidar, b.T_world_lidar, *dt);
}

// The path of a sensor about one of its poses, in that pose's tangent space: at time tau after it,
// c_1 tau + ... + c_m tau^m through m other poses.
class PathAbout {
 public:
  explicit PathAbout(const StampedPose& pose) : pose_(pose) {}

  void Through(const StampedPose& other) {
    const double tau = SecondsBetween(pose_.stamp_ns, other.stamp_ns);
    double power = 1.0;
    for (int k = 0; k < kMost; ++k) powers_(count_, k) = power *= tau;
    ways_.row(count_++) = TwistLog(pose_.T_world_lidar.Inverse() * other.T_world_lidar).transpose();
  }

  bool BeyondThree() const { return count_ > 2; }

  // The motion that is nearest to the path over half_s before and after the pose: the integrals of
  // its difference from the path times tau and times tau^2 vanish for powers above the second, so
  // that 3/5 half_s^2 of c_3 is a velocity, and 5/7 half_s^2 of c_4 one half of an acceleration.
  SweepMotion Nearest(double half_s) const {
    const Coefficients c =
        powers_.topLeftCorner(count_, count_).partialPivLu().solve(ways_.topRows(count_));
    Vector6d velocity = c.row(0).transpose(), half_change = c.row(1).transpose();
    const double half_s2 = half_s * half_s;
    if (count_ > 2) velocity += 3.0 / 5.0 * half_s2 * c.row(2).transpose();
    if (count_ > 3) half_change += 5.0 / 7.0 * half_s2 * c.row(3).transpose();
    return {velocity, 2.0 * half_change};
  }

 private:
  static constexpr int kMost = 4;
  using Powers = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMost, kMost>;
  using Coefficients = Eigen::Matrix<double, Eigen::Dynamic, 6, 0, kMost, 6>;
  StampedPose pose_;
  int count_ = 0;
  Powers powers_ = Powers::Zero(kMost, kMost);
  Coefficients ways_ = Coefficients::Zero(kMost, 6);
};

// The mean velocity over the time between two poses that follow one another.
struct MeanVelocity {
  double at_s = 0.0, over_s = 0.0;
  Vector6d twist = Vector6d::Zero();
};

// Those of the poses around pose i, without a gap among them.
std::vector<MeanVelocity> VelocitiesAround(const Trajectory& poses, std::size_t i,
                                           double max_gap_s) {
  constexpr std::size_t kMost = kMotionNeighbours;
  std::vector<MeanVelocity> velocities;
  for (std::size_t k = i - std::min(i, kMost); k + 1 < poses.size() && k < i + kMost; ++k) {
    MeanVelocity velocity;
    velocity.twist = Velocity(poses[k], poses[k + 1], max_gap_s, &velocity.over_s);
    velocity.at_s = SecondsBetween(poses[i].stamp_ns, poses[k].stamp_ns) + 0.5 * velocity.over_s;
    if (velocity.over_s > 0.0) {
      velocities.push_back(velocity);
    } else if (k >= i) {
      break;
    } else {
      velocities.clear();
    }
  }
  return velocities;
}

// The mean square of the divided differences of a path's poses of this order, each over the
// square of what independent noise of variance 1 of every pose makes of it.
Vector6d MeanSquareDifference(const std::vector<MeanVelocity>& velocities, std::size_t order) {
  Vector6d sum = Vector6d::Zero();
  for (std::size_t first = 0; first + order <= velocities.size(); ++first) {
    Vector6d difference = Vector6d::Zero();
    double noise = 0.0, before = 0.0;
    for (std::size_t k = first; k < first + order; ++k) {
      double weight = 1.0;
      for (std::size_t j = first; j < first + order; ++j) {
        if (j != k) weight /= velocities[k].at_s - velocities[j].at_s;
      }
      difference += weight * velocities[k].twist;
      const double of_pose = weight / velocities[k].over_s;
      noise += (of_pose - before) * (of_pose - before);
      before = of_pose;
    }
    noise += before * before;
    sum += difference.cwiseAbs2() / noise;
  }
  return sum / static_cast<double>(velocities.size() - order + 1);
}

// What differences must exceed to be motion: motion is smooth, so that those of the sixth order are
// noise of the poses almost alone.
Vector6d NoiseOf(const std::vector<MeanVelocity>& velocities) {
  constexpr std::size_t kNoiseOrder = 6;
  // Noise is told by few differences, and that of poses which share a map is not independent.
  constexpr double kNoiseTimes = 3.0;
  return kNoiseTimes * MeanSquareDifference(velocities, std::min(kNoiseOrder, velocities.size()));
}

// How much of the differences of this order is motion and not noise, component by component.
Vector6d ShareOfMotion(const std::vector<MeanVelocity>& velocities, const Vector6d& noise,
                       std::size_t order) {
  if (velocities.size() <= order) return Vector6d::Zero();
  const Vector6d all = MeanSquareDifference(velocities, order);
  Vector6d share = Vector6d::Zero();
  for (int k = 0; k < 6; ++k) {
    if (noise(k) < all(k)) share(k) = 1.0 - noise(k) / all(k);
  }
  return share;
}

// Whether a pose beyond a neighbour of `pose` tells of the path between these two: about as far
// from the neighbour as this one is from the pose, and not turned so far that the tangent space of
// the pose ends.
bool TellsOfPath(const StampedPose& beyond, const StampedPose& neighbour, const StampedPose& pose) {
  constexpr double kMostTurnRad = 1.5, kMostUneven = 2.0;
  const double beyond_s = SecondsBetween(beyond.stamp_ns, neighbour.stamp_ns);
  const double uneven = beyond_s / SecondsBetween(neighbour.stamp_ns, pose.stamp_ns);
  return uneven <= kMostUneven && 1.0 <= kMostUneven * uneven &&
         RotationAngle(pose.T_world_lidar, beyond.T_world_lidar) <= kMostTurnRad;
}

// Through the poses before and after pose i, over half of the shorter time to one of them, and, as
// far as these show motion and not noise, the ones beyond them.
SweepMotion MotionBetween(const Trajectory& poses, std::size_t i, double max_gap_s) {
  const double half_s = 0.5 * std::min(SecondsBetween(poses[i - 1].stamp_ns, poses[i].stamp_ns),
                                       SecondsBetween(poses[i].stamp_ns, poses[i + 1].stamp_ns));
  PathAbout path(poses[i]);
  path.Through(poses[i - 1]);
  path.Through(poses[i + 1]);
  SweepMotion motion = path.Nearest(half_s);
  if (i > 1 && TellsOfPath(poses[i - 2], poses[i - 1], poses[i])) path.Through(poses[i - 2]);
  if (i + 2 < poses.size() && TellsOfPath(poses[i + 2], poses[i + 1], poses[i]))
    path.Through(poses[i + 2]);
  if (!path.BeyondThree()) return motion;
  const std::vector<MeanVelocity> velocities = VelocitiesAround(poses, i, max_gap_s);
  const Vector6d noise = NoiseOf(velocities);
  const SweepMotion curved = path.Nearest(half_s);
  motion.twist += ShareOfMotion(velocities, noise, 3).cwiseProduct(curved.twist - motion.twist);
  motion.acceleration +=
      ShareOfMotion(velocities, noise, 4).cwiseProduct(curved.acceleration - motion.acceleration);
  return motion;
}

}  // namespace

void AddNeighbour(const StampedPose& pose, Trajectory* last) {
  if (last->size() == kMotionNeighbours) last->erase(last->begin());
  last->push_back(pose);
}

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
    *motion = MotionBetween(poses, i, max_gap_s);
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
