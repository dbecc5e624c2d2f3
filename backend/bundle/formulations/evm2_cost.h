// Formulation `evm2`: the smallest eigenvalue with its exact Hessian, on clusters (BALM 2: Liu et
// al., "Efficient and Consistent Bundle Adjustment on Lidar Point Clouds", arXiv 2209.08854).
//
// The cost is that of `condensed`, C = 1/2 sum_planes weight N lambda_3, and so is the gradient;
// the Hessian is the second derivative of C itself. It follows from the same elimination of the
// plane (nu, d) when the second derivatives of the residuals are kept. With q = sum_i r_i p_i = n
// (nu . x_k) mu_k + S m (notation of condensed_cost.h; x_k relative to the plane's mean):
//
//     own block      J'J + [ 1/2 (m q' + q m') - (m . q) I   0;  0  0 ]
//     rows           J'P_j + [ q x R'u_j;  n (nu . x_k) u_j ]
//     plane's own    N diag(l1 - l3, l2 - l3, 1)   in place of   N diag(l1, l2, 1)
//
// which is the eigenvalue perturbation formula of that paper, regrouped so that a plane costs no
// more than in `condensed`. Far from the optimum the Hessian is indefinite, and the solver damps
// until it is not.
//
// Private to backend/bundle/formulations.
#pragma once

#include "backend/bundle/cost.h"
#include "backend/bundle/solver/formulation.h"

namespace lamina {

class Evm2Cost final : public BundleCost {
 public:
  // Keeps a reference: the problem must outlive the cost. Throws as BundleIndex.
  explicit Evm2Cost(const BundleProblem& problem) : problem_(problem), index_(problem) {}

  void Linearise(const std::vector<SE3>& poses, ReducedSystem* system) override;
  double Value(const std::vector<SE3>& poses) const override;

 private:
  const BundleProblem& problem_;
  BundleIndex index_;
};

const Formulation& Evm2Formulation();

}  // namespace lamina
