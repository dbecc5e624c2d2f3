// The trust region that minimises a cost over poses, whatever makes its quadratic model.
//
// A step solves (H + D) delta = -g with the damping D = diag(H) / radius. With the gain rho = (cost
// before - after) / (decrease that the quadratic model promised), it is taken if rho > 1e-3, and
//
//     taken      radius <- radius / max(1/3, 1 - (2 rho - 1)^3)
//     rejected   radius <- radius / 2, then / 4, / 8, ... while it keeps being rejected
//
// (Madsen, Nielsen, Tingleff: Methods for Non-Linear Least Squares Problems, 2004). A Hessian that
// is not positive definite with its damping counts as a rejected step.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "backend/bundle/solver/adjuster.h"

namespace lamina {

// The quadratic model of a cost at some poses, and its damped solutions.
class StepModel {
 public:
  virtual ~StepModel() = default;

  // False if anything is not finite.
  virtual bool Linearise(const std::vector<SE3>& poses) = 0;
  // The cost at the poses of the last linearisation.
  virtual double value() const = 0;
  virtual double Value(const std::vector<SE3>& poses) const = 0;
  // False if the damped matrix is not positive definite. `promised` is the model's decrease.
  virtual bool Solve(double radius, Eigen::VectorXd* step, double* promised) = 0;

  // Whether making and factorising H takes most of a step, or, if `coarse`, at least much of it.
  virtual bool large(bool /*coarse*/) const { return false; }
  // Cost and gradient at these poses, which `step` has led to, with an H of before. False if
  // anything is not finite.
  virtual bool LineariseKeeping(const std::vector<SE3>& /*poses*/,
                                const Eigen::VectorXd& /*step*/) {
    return false;
  }
  // Whether H is one of before.
  virtual bool kept() const { return false; }
};

// |diag(H)|, none less than 1e-9 of the largest: D times the radius.
Eigen::VectorXd DampingScale(const Eigen::VectorXd& diagonal);

// What the model promises of a step: -g' delta - 1/2 delta' H delta = 1/2 delta' D delta - 1/2 g'
// delta.
double PromisedDecrease(const Eigen::VectorXd& gradient, const Eigen::VectorXd& step,
                        const Eigen::VectorXd& damping);

// `may_keep`: whether H may be kept after a step.
BundleResult MinimiseInTrustRegion(const std::vector<SE3>& poses,
                                   const BundleAdjusterOptions& options,
                                   const BundleObserver& observer, bool may_keep, StepModel* model);

}  // namespace lamina
