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

// What Jacobi takes of one number, as of one each of four matrices.
using lamina::AnyLane;
using lamina::SquareRoots;
inline bool AnyLane(bool active) { return active; }
inline void SquareRoots(double* x) { *x = std::sqrt(*x); }
// Sign, 1 or -1, also of a zero, and size.
inline void Split(const double& x, double* sign, double* size) {
  *sign = std::copysign(1.0, x);
  *size = std::abs(x);
}
[[gnu::always_inline]] inline void Split(const Four& x, Four* sign, Four* size) {
  constexpr std::int64_t kSignBit = std::numeric_limits<std::int64_t>::min();
  const auto bits = reinterpret_cast<FourIntegers>(x);
  *sign = reinterpret_cast<Four>((bits & kSignBit) | reinterpret_cast<FourIntegers>(Four{} + 1.0));
  *size = reinterpret_cast<Four>(bits & ~kSignBit);
}

// Cyclic Jacobi rotations of one matrix (double, bool), or of four (Four, FourIntegers), each of
// which stops when it would by itself.
template <typename Real, typename Mask>
struct alignas(Real) Jacobi {
  static constexpr int kPlace[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};

  Real a[6];  // xx xy xz yy yz zz
  Real u[3][3];
  Mask active;

  [[gnu::always_inline]] inline void Run() {
    for (int sweep = 0; sweep < kMaxSweeps && BeginSweep(); ++sweep) {
      Rotate(0, 1, 2);
      Rotate(0, 2, 1);
      Rotate(1, 2, 0);
    }
  }

 private:
  // False if there is nothing left to do.
  [[gnu::always_inline]] inline bool BeginSweep() {
    const Real off = a[1] * a[1] + a[2] * a[2] + a[4] * a[4];
    const Real diagonal = a[0] * a[0] + a[3] * a[3] + a[5] * a[5];
    active &= off > kDiagonal * diagonal;
    return AnyLane(active);
  }

  // In the plane (p, q), so that a(p, q) becomes zero; r is the third index.
  [[gnu::always_inline]] inline void Rotate(int p, int q, int r) {
    Real& app = a[kPlace[p][p]];
    Real& aqq = a[kPlace[q][q]];
    Real& apq = a[kPlace[p][q]];
    Real& apr = a[kPlace[p][r]];
    Real& aqr = a[kPlace[q][r]];
    const Mask turns = active & (apq != 0.0);
    const Real zero{}, one = zero + 1.0;
    const Real theta = 0.5 * (aqq - app) / (turns ? apq : one);
    Real sign, size, root = theta * theta + 1.0;
    Split(theta, &sign, &size);
    SquareRoots(&root);
    const Real t = turns ? sign / (size + root) : zero;
    root = t * t + 1.0;
    SquareRoots(&root);
    const Real c = 1.0 / root;
    const Real s = t * c;
    app = turns ? app - t * apq : app;
    aqq = turns ? aqq + t * apq : aqq;
    apq = turns ? zero : apq;
    const Real old_apr = apr;
    apr = turns ? c * old_apr - s * aqr : apr;
    aqr = turns ? s * old_apr + c * aqr : aqr;
#pragma GCC unroll 3
    for (int i = 0; i < 3; ++i) {
      const Real up = u[i][p], uq = u[i][q];
      u[i][p] = turns ? c * up - s * uq : up;
      u[i][q] = turns ? s * up + c * uq : uq;
    }
  }
};

struct JacobiLanes : Jacobi<Four, FourIntegers> {
  [[gnu::always_inline]] inline void Set(std::size_t lane, const Symmetric3& s) {
    const double values[6] = {s.xx, s.xy, s.xz, s.yy, s.yz, s.zz};
    for (int i = 0; i < 6; ++i) a[i][lane] = values[i];
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) u[r][c][lane] = r == c ? 1.0 : 0.0;
    }
    active[lane] = -1;
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
  Jacobi<double, bool> jacobi = {{s.xx, s.xy, s.xz, s.yy, s.yz, s.zz},
                                 {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}},
                                 true};
  jacobi.Run();
  using Vectors = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  return Ordered({jacobi.a[0], jacobi.a[3], jacobi.a[5]}, Vectors::Map(jacobi.u[0]));
}

LAMINA_FOR_EACH_PROCESSOR
void EigenDecompose(const Symmetric3* s, std::size_t count, Eigen3* results) {
  for (std::size_t i = 0; i < count; i += 4) {
    JacobiLanes lanes;
    for (std::size_t k = 0; k < 4; ++k) lanes.Set(k, s[std::min(i + k, count - 1)]);
    lanes.Run();
    for (std::size_t k = 0; k < 4 && i + k < count; ++k) results[i + k] = lanes.Result(k);
  }
}

}  // namespace lamina
