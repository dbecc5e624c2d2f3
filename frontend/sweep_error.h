// The error of a match by motion within the scan that is not steady.
//
// Deskewing takes the body twist between the last pose, a gap T before this one, and this pose for
// constant. That interpolates the motion linearly between tau = -T and tau = 0, and with an
// acceleration a (body, rad/s^2 and m/s^2) it leaves a point that was measured at tau off by
//
//     a g(tau),    g(tau) = tau (tau + T) / 2,
//
// as of any linear interpolation: nothing at both poses, a T^2 at the end of a sweep that begins
// with its pose. All points of one instant are off together, so no residual tells. With the
// residuals' rows J (a twist of the points changes them as one of the pose does) the pose of least
// squares moves by
//
//     -H^-1 H_g a,    H = sum w J'J,    H_g = sum w g(tau) J'J,
//
// and its covariance grows by H^-1 H_g Sigma_a H_g' H^-1. Sigma_a is taken from how the twist
// changed from scan to scan of late, errors of the poses included: they make the twist wrong by as
// much as it seems to change.
#pragma once

#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"

namespace lamina {

// Second moment of the acceleration, of the body twist [w; v], over the scans of late. Plain data.
class RecentAcceleration {
 public:
  // The twist's change from one scan to the next, over `gap_s` > 0.
  void Add(const Vector6d& twist_change, double gap_s);
  // With one more, which is not kept.
  Matrix6d MomentWith(const Vector6d& twist_change, double gap_s) const;
  const Matrix6d& moment() const { return moment_; }  // (rad/s^2)^2, (m/s^2)^2
  void Clear() { *this = RecentAcceleration(); }

  void Archive(StateArchive& a) { a(&scans_, &moment_); }

 private:
  double scans_ = 0.0;  // at most kRecent
  Matrix6d moment_ = Matrix6d::Zero();
};

}  // namespace lamina
