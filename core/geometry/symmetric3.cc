#include "core/geometry/symmetric3.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "core/base/lane_math.h"
#include "core/base/processor.h"

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

constexpr int kMaxSweeps = 12;  // Convergence is quadratic: four or five are the rule.
constexpr double kDiagonal = 1e-34;

// The largest first.
inline Eigen3 Ordered(const std::array<double, 3>& l, const Eigen::Matrix3d& u) {
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

// Rotate for four matrices, each of which stops when it would by itself.
struct alignas(32) JacobiLanes {
  static constexpr int kPlace[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};

  Four a[6];  // xx xy xz yy yz zz
  Four u[3][3];
  FourIntegers active;

  [[gnu::always_inline]] inline void Set(std::size_t lane, const Symmetric3& s) {
    const double values[6] = {s.xx, s.xy, s.xz, s.yy, s.yz, s.zz};
    for (int i = 0; i < 6; ++i) a[i][lane] = values[i];
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) u[r][c][lane] = r == c ? 1.0 : 0.0;
    }
    active[lane] = -1;
  }

  // False if there is nothing left to do.
  [[gnu::always_inline]] inline bool BeginSweep() {
    const Four off = a[1] * a[1] + a[2] * a[2] + a[4] * a[4];
    const Four diagonal = a[0] * a[0] + a[3] * a[3] + a[5] * a[5];
    active &= off > kDiagonal * diagonal;
    return AnyLane(active);
  }

  [[gnu::always_inline]] inline void Rotate(int p, int q, int r) {
    Four& app = a[kPlace[p][p]];
    Four& aqq = a[kPlace[q][q]];
    Four& apq = a[kPlace[p][q]];
    Four& apr = a[kPlace[p][r]];
    Four& aqr = a[kPlace[q][r]];
    const FourIntegers turns = active & (apq != 0.0);
    const Four one = Four{} + 1.0;
    const FourIntegers sign_bit = FourIntegers{} + std::numeric_limits<std::int64_t>::min();
    const Four theta = 0.5 * (aqq - app) / (turns ? apq : one);
    const auto sign = reinterpret_cast<Four>((reinterpret_cast<FourIntegers>(theta) & sign_bit) |
                                             reinterpret_cast<FourIntegers>(one));
    const auto size = reinterpret_cast<Four>(reinterpret_cast<FourIntegers>(theta) & ~sign_bit);
    Four root = theta * theta + 1.0;
    SquareRoots(&root);
    const Four t = turns ? sign / (size + root) : Four{};
    root = t * t + 1.0;
    SquareRoots(&root);
    const Four c = 1.0 / root;
    const Four s = t * c;
    app = turns ? app - t * apq : app;
    aqq = turns ? aqq + t * apq : aqq;
    apq = turns ? Four{} : apq;
    const Four old_apr = apr;
    apr = turns ? c * old_apr - s * aqr : apr;
    aqr = turns ? s * old_apr + c * aqr : aqr;
#pragma GCC unroll 3
    for (int i = 0; i < 3; ++i) {
      const Four up = u[i][p], uq = u[i][q];
      u[i][p] = turns ? c * up - s * uq : up;
      u[i][q] = turns ? s * up + c * uq : uq;
    }
  }

  [[gnu::always_inline]] inline Eigen3 Result(std::size_t lane) const {
    Eigen::Matrix3d vectors;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) vectors(r, c) = u[r][c][lane];
    }
    return Ordered({a[0][lane], a[3][lane], a[5][lane]}, vectors);
  }
};

}  // namespace

Eigen3 EigenDecompose(const Symmetric3& s) {
  Symmetric3 a = s;
  Eigen::Matrix3d u = Eigen::Matrix3d::Identity();
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    const double off = a.xy * a.xy + a.xz * a.xz + a.yz * a.yz;
    const double diagonal = a.xx * a.xx + a.yy * a.yy + a.zz * a.zz;
    if (!(off > kDiagonal * diagonal)) break;
    Rotate(a.xx, a.yy, a.xy, a.xz, a.yz, u, 0, 1);
    Rotate(a.xx, a.zz, a.xz, a.xy, a.yz, u, 0, 2);
    Rotate(a.yy, a.zz, a.yz, a.xy, a.xz, u, 1, 2);
  }
  return Ordered({a.xx, a.yy, a.zz}, u);
}

LAMINA_FOR_EACH_PROCESSOR
void EigenDecompose(const Symmetric3* s, std::size_t count, Eigen3* results) {
  for (std::size_t i = 0; i < count; i += 4) {
    JacobiLanes lanes;
    for (std::size_t k = 0; k < 4; ++k) lanes.Set(k, s[std::min(i + k, count - 1)]);
    for (int sweep = 0; sweep < kMaxSweeps && lanes.BeginSweep(); ++sweep) {
      lanes.Rotate(0, 1, 2);
      lanes.Rotate(0, 2, 1);
      lanes.Rotate(1, 2, 0);
    }
    for (std::size_t k = 0; k < 4 && i + k < count; ++k) results[i + k] = lanes.Result(k);
  }
}

}  // namespace lamina
