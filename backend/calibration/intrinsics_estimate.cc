#include "backend/calibration/intrinsics_estimate.h"

#include <algorithm>
#include <cmath>

#include "core/base/angle.h"

namespace lamina {
namespace {

const Intrinsics kLargestStep(0.3 * kDegree, 0.1);
const Intrinsics kPriorInformation(std::pow(5.0 * kDegree, -2), 1.0);

}  // namespace

void IntrinsicsEstimate::Add(const IntrinsicsSystem& s) {
  if (!s.H.allFinite() || !s.g.allFinite() || !s.g_by_elevation.allFinite()) return;
  H_ += s.H;
  g_ += s.g;
  by_problem_ += s.g * s.g.transpose();
  by_elevation_ += s.g_by_elevation;
  ++problems_;
}

Eigen::Matrix2d IntrinsicsEstimate::Covariance(const ActiveIntrinsics& active) const {
  Eigen::Matrix2d known = H_;
  known.diagonal() += kPriorInformation;
  if (active[0] && active[1]) return known.inverse();
  Eigen::Matrix2d inverse = Eigen::Matrix2d::Zero();
  for (int i = 0; i < 2; ++i) {
    if (active[static_cast<std::size_t>(i)]) inverse(i, i) = 1.0 / known(i, i);
  }
  return inverse;
}

Intrinsics IntrinsicsEstimate::Step(const ActiveIntrinsics& active,
                                    const Intrinsics& offsets) const {
  const Intrinsics step = -(Covariance(active) * (g_ + kPriorInformation.cwiseProduct(offsets)));
  return step / std::max(1.0, step.cwiseAbs().cwiseQuotient(kLargestStep).maxCoeff());
}

Intrinsics IntrinsicsEstimate::FormalSigma(const ActiveIntrinsics& active) const {
  return Covariance(active).diagonal().cwiseSqrt();
}

Intrinsics IntrinsicsEstimate::Sigma(const ActiveIntrinsics& active) const {
  const Eigen::Matrix2d formal = Covariance(active);
  Intrinsics variance = formal.diagonal();
  const auto consider = [&](const Eigen::Matrix2d& spread, Eigen::Index groups) {
    constexpr Eigen::Index kLeastGroups = 4;
    if (groups < kLeastGroups) return;
    const auto n = static_cast<double>(groups);
    const Eigen::Matrix2d about_mean = spread - g_ * g_.transpose() / n;
    const Eigen::Matrix2d seen = n / (n - 2.0) * formal * about_mean * formal;
    variance = variance.cwiseMax(Intrinsics(seen.diagonal()));
  };
  consider(by_problem_, static_cast<Eigen::Index>(problems_));
  consider(by_elevation_ * by_elevation_.transpose(),
           (by_elevation_.colwise().squaredNorm().array() > 0.0).count());
  return variance.cwiseSqrt();
}

}  // namespace lamina
