// Symmetric 3x3 matrices in six numbers, and their eigenvalues to full precision.
#pragma once

#include <Eigen/Core>
#include <cstddef>

namespace lamina {

// The upper triangle of a symmetric 3x3 matrix.
struct Symmetric3 {
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;

  Symmetric3& operator+=(const Symmetric3& o) {
    xx += o.xx, xy += o.xy, xz += o.xz, yy += o.yy, yz += o.yz, zz += o.zz;
    return *this;
  }
  Symmetric3 operator*(double s) const { return {xx * s, xy * s, xz * s, yy * s, yz * s, zz * s}; }
  // Adds s a a'.
  void AddOuter(double s, const Eigen::Vector3d& a) {
    const Eigen::Vector3d sa = s * a;
    xx += sa.x() * a.x(), xy += sa.x() * a.y(), xz += sa.x() * a.z();
    yy += sa.y() * a.y(), yz += sa.y() * a.z(), zz += sa.z() * a.z();
  }
  Eigen::Vector3d operator*(const Eigen::Vector3d& v) const {
    return {xx * v.x() + xy * v.y() + xz * v.z(), xy * v.x() + yy * v.y() + yz * v.z(),
            xz * v.x() + yz * v.y() + zz * v.z()};
  }
  double Trace() const { return xx + yy + zz; }
  Eigen::Matrix3d Dense() const {
    Eigen::Matrix3d m;
    m << xx, xy, xz, xy, yy, yz, xz, yz, zz;
    return m;
  }
  // The upper triangle of m is read.
  static Symmetric3 FromDense(const Eigen::Matrix3d& m) {
    return {m(0, 0), m(0, 1), m(0, 2), m(1, 1), m(1, 2), m(2, 2)};
  }
  // R S R'.
  Symmetric3 Rotated(const Eigen::Matrix3d& R) const {
    const Eigen::Matrix3d A = R * Dense();
    return {A.row(0).dot(R.row(0)), A.row(0).dot(R.row(1)), A.row(0).dot(R.row(2)),
            A.row(1).dot(R.row(1)), A.row(1).dot(R.row(2)), A.row(2).dot(R.row(2))};
  }
};

// Eigenvalues in the order of the paper, l(0) >= l(1) >= l(2); u.col(i) belongs to l(i).
struct Eigen3 {
  Eigen::Vector3d l;
  Eigen::Matrix3d u;
};

// Cyclic Jacobi rotations: unlike the closed-form (trigonometric) solution, the smallest eigenvalue
// keeps its digits, and that one is the thickness of a plane. Deterministic.
Eigen3 EigenDecompose(const Symmetric3& s);
// The same of many, four at a time: each comes out with the bits that it has by itself.
void EigenDecompose(const Symmetric3* s, std::size_t count, Eigen3* results);

}  // namespace lamina
