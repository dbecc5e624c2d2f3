#include "backend/bundle/solver/trust_region.h"

#include <gtest/gtest.h>

namespace lamina {
namespace {

// Its cost is what the first pose's x is off from 1; its matrix is positive definite from some
// damping on.
class OneAxis final : public StepModel {
 public:
  explicit OneAxis(double solvable_below) : solvable_below_(solvable_below) {}

  bool Linearise(const std::vector<SE3>& poses) override {
    value_ = Value(poses);
    off_ = 1.0 - poses[0].t.x();
    return true;
  }
  double value() const override { return value_; }
  double Value(const std::vector<SE3>& poses) const override {
    return (poses[0].t - Eigen::Vector3d::UnitX()).squaredNorm();
  }
  bool Solve(double radius, Eigen::VectorXd* step, double* promised) override {
    if (radius >= solvable_below_) return false;
    *step = off_ * Vector6d::Unit(3);
    *promised = value_;
    return true;
  }

 private:
  double solvable_below_, value_ = 0.0, off_ = 0.0;
};

BundleResult Minimise(double solvable_below) {
  OneAxis model(solvable_below);
  BundleAdjusterOptions options;
  options.max_iterations = 20;
  return MinimiseInTrustRegion({SE3()}, options, nullptr, false, &model);
}

TEST(TrustRegion, WhatCannotBeFactorisedIsDampedUntilItCan) {
  const BundleResult result = Minimise(1.0);
  EXPECT_EQ(result.status, BundleResult::Status::kConverged);
  EXPECT_NEAR(result.poses[0].t.x(), 1.0, 1e-12);
}

TEST(TrustRegion, WithoutAnyStepItHasFailed) {
  const BundleResult result = Minimise(0.0);
  EXPECT_EQ(result.status, BundleResult::Status::kFailed);
  EXPECT_FALSE(result.usable());
  EXPECT_EQ(result.poses[0].t, Eigen::Vector3d::Zero());
}

}  // namespace
}  // namespace lamina
