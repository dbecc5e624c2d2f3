// How a sensor moves during a scan.
#pragma once

#include <cstddef>

#include "core/geometry/scan.h"
#include "core/geometry/se3.h"

namespace lamina {

// The *reference instant* of a scan is the one from which the times of its points count, tau = 0:
// its stamp, or, inside mapping (after CentreTimes), the middle of its sweep.
//
// The body velocity [w; v] (rad/s, m/s) at the reference instant, and how fast it changes (rad/s^2,
// m/s^2). The pose tau seconds after that instant, relative to the one at it, is
//
//     Exp(tau xi + tau^2/2 a):
//
// exact where both turn about one axis, and to O(tau^3) otherwise.
struct SweepMotion {
  Vector6d twist = Vector6d::Zero();
  Vector6d acceleration = Vector6d::Zero();
  // Found from the scan itself, because the poses before and after it do not tell it: the sensor
  // was shaken.
  bool of_scan = false;

  SweepMotion() = default;
  // A steady motion; a twist alone is one.
  SweepMotion(const Vector6d& steady) : twist(steady) {}
  SweepMotion(const Vector6d& at_stamp, const Vector6d& change)
      : twist(at_stamp), acceleration(change) {}

  // With this mean velocity over the `seconds` before the reference instant, or after it where they
  // are negative.
  static SweepMotion WithMean(const Vector6d& mean, double seconds, const Vector6d& change) {
    return {mean + 0.5 * seconds * change, change};
  }

  SE3 PoseAt(double tau) const { return TwistExp(tau * twist + 0.5 * tau * tau * acceleration); }
  Vector6d TwistAt(double tau) const { return twist + tau * acceleration; }
};

// How many poses on either side of a scan its motion may be found from.
constexpr std::size_t kMotionNeighbours = 7;
// Adds a pose to the last ones before a scan, of which no more than these are kept.
void AddNeighbour(const StampedPose& pose, Trajectory* last);

// The motion during the scan at pose i: through the poses before and after it, with velocities
// v_b over the time t_b since the one and v_a over t_a until the other,
//
//     xi = (t_a v_b + t_b v_a) / (t_a + t_b),    a = 2 (v_a - v_b) / (t_a + t_b).
//
// That alone misses a tenth of what a vibration of 1.4 Hz does within half a sweep of 0.1 s: of a
// roll of 0.6 degrees, a centimetre at 25 m. The polynomial of fourth degree through two poses on
// either side misses less than a hundredth, but makes more of the poses' noise. So each component
// of xi and a is moved towards that polynomial, as near as it comes to it with two powers over the
// sweep, by the share of motion in the differences of third order of the poses around (of fourth
// order for a): 1 - 3 n / d, d their mean square, and n that of the sixth order, which are noise
// almost alone, each over the square of what independent noise of the poses makes of it.
//
// Where one of the neighbours is missing, or stamps do not increase or lie more than max_gap_s
// apart, through the other, and the acceleration stays as it is, or is that at the pose after it if
// it is the one before that is missing. False, and *motion untouched, if there is none. One that is
// of the scan itself stays as it is.
bool MotionThrough(const Trajectory& poses, std::size_t i, double max_gap_s, SweepMotion* motion);

// The motions during two scans of which only the difference is known, as at the start of a map: one
// that is made of a scan bent by its motion bends the next scan's motion along. With the mean
// velocity m over the time t between the reference instants, D and A the differences of twist and
// acceleration (second less first), and the scans' motions meeting half-way in time,
//
//     xi_1 = m + t A / 8 - D / 2,    a_1 = -A / 2,    xi_2 = xi_1 + D,    a_2 = a_1 + A:
//
// as likely as any, since both may be shaken alike. Returns the first one's.
SweepMotion FirstOfTwo(const Vector6d& mean, double seconds, const SweepMotion& first,
                       const SweepMotion& second);

}  // namespace lamina
