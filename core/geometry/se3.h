// Rigid-body poses, SE(3), and the one convention for perturbing them.
//
// A pose is named by the two frames that it joins: `T_world_lidar` maps coordinates of the LiDAR
// frame to the world frame, p_world = T_world_lidar * p_lidar. Units: metres, radians.
//
// Tangent vectors are 6x1, ordered [rotation; translation]. Perturbation of T = (R, t) by
// delta = [w; v]:
//
//     T [+] delta = (R Exp(w), t + v)                 rotation on the right, translation in world
//
// Exp(w) is the rotation about w by |w| (Rodrigues). This is the retraction of every solver here.
//
// A *twist* [w; v] is something else: a constant body velocity (rad/s, m/s), integrated by
// TwistExp, the exponential map of SE(3), which couples rotation and translation.
//
// Rotations are unit quaternions and every product is normalised again: chains of thousands of
// products stay orthonormal, which plain matrices do not.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace lamina {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

// [a]x, so that Hat(a) * b = a x b.
inline Eigen::Matrix3d Hat(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0.0, -a.z(), a.y(), a.z(), 0.0, -a.x(), -a.y(), a.x(), 0.0;
  return m;
}

// Rotation by |w| radians about w.
inline Eigen::Quaterniond ExpSO3(const Eigen::Vector3d& w) {
  const double theta2 = w.squaredNorm();
  const double theta = std::sqrt(theta2);
  // sin(x/2)/x by its series where the quotient would lose digits.
  const double k = theta < 1e-4 ? 0.5 - theta2 / 48.0 : std::sin(0.5 * theta) / theta;
  return Eigen::Quaterniond(std::cos(0.5 * theta), k * w.x(), k * w.y(), k * w.z());
}

// Inverse of ExpSO3; the result has norm in [0, pi].
inline Eigen::Vector3d LogSO3(const Eigen::Quaterniond& q) {
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  const Eigen::Vector3d v = sign * q.vec();
  const double n = v.norm();
  if (n < 1e-10) return 2.0 * v;
  return (2.0 * std::atan2(n, sign * q.w()) / n) * v;
}

struct SE3 {
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
  Eigen::Vector3d t = Eigen::Vector3d::Zero();

  SE3() = default;
  SE3(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation)
      : q(rotation.normalized()), t(translation) {}
  SE3(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation)
      : q(Eigen::Quaterniond(rotation).normalized()), t(translation) {}

  Eigen::Matrix3d R() const { return q.toRotationMatrix(); }
  SE3 Inverse() const { return SE3(q.conjugate(), -(q.conjugate() * t)); }
  SE3 operator*(const SE3& b) const { return SE3(q * b.q, q * b.t + t); }
  Eigen::Vector3d operator*(const Eigen::Vector3d& p) const { return q * p + t; }
};

// T [+] delta, see the head of this file.
inline SE3 Retract(const SE3& T, const Vector6d& delta) {
  return SE3(T.q * ExpSO3(delta.head<3>()), T.t + delta.tail<3>());
}

// The delta with Retract(a, delta) = b.
inline Vector6d LocalDelta(const SE3& a, const SE3& b) {
  Vector6d delta;
  delta << LogSO3(a.q.conjugate() * b.q), b.t - a.t;
  return delta;
}

// Pose reached after one unit of time with the constant body twist [w; v].
SE3 TwistExp(const Vector6d& twist);

// The twist with TwistExp(twist) = T.
Vector6d TwistLog(const SE3& T);

// The constant twist that leads from a to b in so many seconds.
inline Vector6d MeanTwist(const SE3& a, const SE3& b, double seconds) {
  return TwistLog(a.Inverse() * b) / seconds;
}

// The geodesic from a (s = 0) to b (s = 1); s outside of [0, 1] extrapolates.
inline SE3 Interpolate(const SE3& a, const SE3& b, double s) {
  return a * TwistExp(s * TwistLog(a.Inverse() * b));
}

// Angle of the rotation between a and b, in [0, pi].
inline double RotationAngle(const SE3& a, const SE3& b) {
  return LogSO3(a.q.conjugate() * b.q).norm();
}

// Whether a and b lie no farther apart than this, and are turned no more.
inline bool AreClose(const SE3& a, const SE3& b, double most_m, double most_rad) {
  return (a.t - b.t).norm() <= most_m && RotationAngle(a, b) <= most_rad;
}

}  // namespace lamina
