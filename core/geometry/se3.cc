#include "core/geometry/se3.h"

namespace lamina {
namespace {

// V of the exponential map: t = V(w) v.  V = I + a [w]x + b [w]x^2.
Eigen::Matrix3d TranslationFactor(const Eigen::Vector3d& w) {
  const double theta2 = w.squaredNorm();
  const double theta = std::sqrt(theta2);
  double a = 0.5 - theta2 / 24.0;
  double b = 1.0 / 6.0 - theta2 / 120.0;
  if (theta > 1e-3) {
    a = (1.0 - std::cos(theta)) / theta2;
    b = (theta - std::sin(theta)) / (theta2 * theta);
  }
  const Eigen::Matrix3d W = Hat(w);
  return Eigen::Matrix3d::Identity() + a * W + b * W * W;
}

}  // namespace

SE3 TwistExp(const Vector6d& twist) {
  const Eigen::Vector3d w = twist.head<3>();
  return SE3(ExpSO3(w), TranslationFactor(w) * twist.tail<3>());
}

Vector6d TwistLog(const SE3& T) {
  const Eigen::Vector3d w = LogSO3(T.q);
  Vector6d twist;
  twist << w, TranslationFactor(w).partialPivLu().solve(T.t);
  return twist;
}

}  // namespace lamina
