#include "tools/metrics/truth_axes.h"

#include <fmt/format.h>

#include <Eigen/SVD>
#include <cmath>

#include "core/base/angle.h"

namespace lamina {

std::string DescribeOtherAxes(const ComparedTrajectory& compared) {
  // Steps that do not fit are half as long as the steps themselves at least, those that fit five
  // times shorter than that.
  constexpr double kLeastMisfit = 0.5, kMostLeft = 0.2;
  constexpr double kLeastStepM = 1e-3, kLeastTurnDeg = 20.0;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  std::vector<Eigen::Vector3d> a, b;
  double steps2 = 0.0, misfit2 = 0.0;
  for (std::size_t i = 0; i + 1 < compared.truth.size(); ++i) {
    const auto step = [i](const Trajectory& t) {
      return (t[i].T_world_lidar.Inverse() * t[i + 1].T_world_lidar).t;
    };
    a.push_back(step(compared.estimate));
    b.push_back(step(compared.truth));
    covariance += b.back() * a.back().transpose();
    steps2 += b.back().squaredNorm();
    misfit2 += (b.back() - a.back()).squaredNorm();
  }
  if (a.empty() || steps2 < kLeastStepM * kLeastStepM * static_cast<double>(a.size())) return "";
  if (misfit2 < kLeastMisfit * kLeastMisfit * steps2) return "";
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sign = Eigen::Vector3d::Ones();
  if ((svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0) sign.z() = -1.0;
  const Eigen::Matrix3d R = svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
  double left2 = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) left2 += (b[i] - R * a[i]).squaredNorm();
  const double turn_deg = Degrees(Eigen::AngleAxisd(R).angle());
  if (left2 > kMostLeft * kMostLeft * misfit2 || turn_deg < kLeastTurnDeg) return "";
  constexpr double kAligned = 0.9;
  // A camera looks along z.
  const std::string axes = R(2, 0) > kAligned
                               ? "in the axes of a camera (z ahead)"
                               : fmt::format("in axes turned by {:.0f} deg", turn_deg);
  return fmt::format(
      "the poses of the truth are {}, not those of the LiDAR: {} moves {:.3f} m otherwise from "
      "frame to frame ({:.3f} m if turned); errors of relative poses mean nothing until the "
      "truth's calibration (line \"Tr:\" of calib.txt) is applied",
      axes, compared.name, std::sqrt(misfit2 / static_cast<double>(a.size())),
      std::sqrt(left2 / static_cast<double>(a.size())));
}

}  // namespace lamina
