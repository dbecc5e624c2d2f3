// The offsets of a sensor from the systems of several bundle problems, and how well they are known.
//
// With H = sum H_s and g = sum g_s over the problems (intrinsics_cost.h), a Gauss-Newton step is
// -H^-1 g. The variance of each offset is the largest of three: that of H^-1, and what the spread
// of the gradient shows (White's sandwich estimator, 1980), gathered by problem, and by elevation
// of the beams,
//
//     H^-1 (G / (G - 2) sum_i g_i g_i') H^-1,   G groups, four or more
//
// The last is what decides on a real sensor, each of whose beams is off by something of its own.
//
// Private to backend/calibration.
#pragma once

#include <array>
#include <cstddef>

#include "backend/calibration/intrinsics_cost.h"

namespace lamina {

// Which of the two are solved for.
using ActiveIntrinsics = std::array<bool, 2>;

class IntrinsicsEstimate {
 public:
  // Nothing happens if it is not finite.
  void Add(const IntrinsicsSystem& system);
  std::size_t problems() const { return problems_; }

  // From these offsets, no longer than the linearisation is good for. A weak prior (5 deg, 1 m)
  // keeps it finite. Zero for what is not active.
  Intrinsics Step(const ActiveIntrinsics& active, const Intrinsics& offsets) const;
  // Standard deviations: by the weights alone, and the largest of the three. Zero for what is not
  // active.
  Intrinsics FormalSigma(const ActiveIntrinsics& active) const;
  Intrinsics Sigma(const ActiveIntrinsics& active) const;

 private:
  Eigen::Matrix2d Covariance(const ActiveIntrinsics& active) const;

  Eigen::Matrix2d H_ = Eigen::Matrix2d::Zero();
  Eigen::Vector2d g_ = Eigen::Vector2d::Zero();
  Eigen::Matrix2d by_problem_ = Eigen::Matrix2d::Zero();  // sum g_s g_s'
  GradientByElevation by_elevation_ = GradientByElevation::Zero();
  std::size_t problems_ = 0;
};

}  // namespace lamina
