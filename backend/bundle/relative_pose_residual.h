// Residual of a measured relative pose, for Ceres.
//
//     r = W [Log(dR); dt],   dT = Z^-1 T_world_from^-1 T_world_to
//
// Z is the measured T_from_to, and W'W the information of [rotation; translation] of dT, both in
// the frame of `to`. Blocks: quaternion (coefficients in Eigen's order) and translation of either
// pose.
#pragma once

#include <ceres/ceres.h>

#include "core/geometry/robust_kernel.h"
#include "core/geometry/se3.h"

namespace lamina {

// dT at these poses.
inline SE3 RelativeError(const SE3& T_from_to, const SE3& T_world_from, const SE3& T_world_to) {
  return T_from_to.Inverse() * (T_world_from.Inverse() * T_world_to);
}

struct RelativePoseResidual {
  SE3 T_to_from;  // measured, inverse
  Matrix6d sqrt_information;

  template <typename T>
  bool operator()(const T* q_from, const T* t_from, const T* q_to, const T* t_to, T* r) const {
    using Quaternion = Eigen::Quaternion<T>;
    using Vector = Eigen::Matrix<T, 3, 1>;
    const Eigen::Map<const Quaternion> qa(q_from), qb(q_to);
    const Eigen::Map<const Vector> ta(t_from), tb(t_to);
    const Quaternion q_between = qa.conjugate() * qb;
    const Vector t_between = qa.conjugate() * Vector(tb - ta);
    Quaternion dq = T_to_from.q.cast<T>() * q_between;
    if (dq.w() < T(0.0)) dq.coeffs() = -dq.coeffs();
    Eigen::Matrix<T, 6, 1> d;
    // 2 vec(dq) is Log(dR) up to its third order, and has derivatives at zero.
    d.template head<3>() = T(2.0) * dq.vec();
    d.template tail<3>() = T_to_from.q.cast<T>() * t_between + T_to_from.t.cast<T>();
    Eigen::Map<Eigen::Matrix<T, 6, 1>> out(r);
    out = sqrt_information.template cast<T>() * d;
    return true;
  }

  static ceres::CostFunction* Cost(const SE3& T_from_to, const Matrix6d& sqrt_information) {
    return new ceres::AutoDiffCostFunction<RelativePoseResidual, 6, 4, 3, 4, 3>(
        new RelativePoseResidual{T_from_to.Inverse(), sqrt_information});
  }
};

// rho(s) = s / (1 + s / scale^2): twice that of core/geometry/robust_kernel.h, in units of scale^2,
// for s = scale^2 e^2.
class GemanMcClureLoss final : public ceres::LossFunction {
 public:
  explicit GemanMcClureLoss(double scale) : scale2_(scale * scale) {}
  void Evaluate(double s, double out[3]) const override {
    const double d = GemanMcClureFit(s / scale2_);
    out[0] = s * d;
    out[1] = d * d;
    out[2] = -2.0 * d * d * d / scale2_;
  }

 private:
  double scale2_;
};

}  // namespace lamina
