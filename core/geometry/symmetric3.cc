#include "core/geometry/symmetric3.h"

#include <array>
#include <cmath>
#include <utility>

namespace lamina {
namespace {

// One Jacobi rotation in the plane (p, q) that makes a(p, q) zero; r is the third index.
inline void Rotate(double& app, double& aqq, double& apq, double& apr, double& aqr,
                   Eigen::Matrix3d& u, int p, int q) {
  if (apq == 0.0) return;
  const double theta = 0.5 * (aqq - app) / apq;
  const double t = std::copysign(1.0, theta) / (std::abs(theta) + std::sqrt(theta * theta + 1.0));
  const double c = 1.0 / std::sqrt(t * t + 1.0);
  const double s = t * c;
  app -= t * apq;
  aqq += t * apq;
  apq = 0.0;
  const double old_apr = apr;
  apr = c * old_apr - s * aqr;
  aqr = s * old_apr + c * aqr;
  const Eigen::Vector3d up = u.col(p);
  u.col(p) = c * up - s * u.col(q);
  u.col(q) = s * up + c * u.col(q);
}

}  // namespace

Eigen3 EigenDecompose(const Symmetric3& s) {
  Symmetric3 a = s;
  Eigen::Matrix3d u = Eigen::Matrix3d::Identity();
  constexpr int kMaxSweeps = 12;  // Convergence is quadratic: four or five are the rule.
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    const double off = a.xy * a.xy + a.xz * a.xz + a.yz * a.yz;
    const double diagonal = a.xx * a.xx + a.yy * a.yy + a.zz * a.zz;
    if (!(off > 1e-34 * diagonal)) break;
    Rotate(a.xx, a.yy, a.xy, a.xz, a.yz, u, 0, 1);
    Rotate(a.xx, a.zz, a.xz, a.xy, a.yz, u, 0, 2);
    Rotate(a.yy, a.zz, a.yz, a.xy, a.xz, u, 1, 2);
  }
  const std::array<double, 3> l = {a.xx, a.yy, a.zz};
  std::array<int, 3> order = {0, 1, 2};
  if (l[0] < l[1]) std::swap(order[0], order[1]);
  if (l[static_cast<size_t>(order[1])] < l[2]) std::swap(order[1], order[2]);
  if (l[static_cast<size_t>(order[0])] < l[static_cast<size_t>(order[1])])
    std::swap(order[0], order[1]);
  Eigen3 result;
  for (int i = 0; i < 3; ++i) {
    const int k = order[static_cast<size_t>(i)];
    result.l(i) = l[static_cast<size_t>(k)];
    result.u.col(i) = u.col(k);
  }
  return result;
}

}  // namespace lamina
