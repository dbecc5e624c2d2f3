// Formulation `condensed`: the planes condensed out (variable projection), Gauss-Newton.
//
// For a plane with unit normal nu and offset d, the points p of frame k have residuals
// r = nu . (R_k p + t_k) - d. Minimised over (nu, d), their sum of squares over all frames is
//
//     N lambda_3(Sigma),    (N, mu, Sigma) = fixed + sum_k  cluster_k moved by (R_k, t_k)
//
// with lambda_3 the smallest eigenvalue (BALM's objective; nu its eigenvector u_3, d = nu . mu). It
// equals the paper's objective (Huang et al. 2021, eq. 10) with the weights (l1 - l3, l2 - l3) in
// place of (l1, l2), up to the constant sum_k n_k l3_k, see EigenvalueLowerBound. The cost here is
//
//     C = 1/2 sum_planes  weight * N lambda_3(Sigma)
//
// Derivatives. With J the Jacobian of all r by the poses and P by the plane's own variables (two
// angles along the eigenvectors u_1, u_2 and the offset), P'P = N diag(l1, l2, 1) and P'r = 0 at
// the optimum, so
//
//     g = J'r  (exact),      H = J'J - J'P (P'P)^-1 P'J   (Gauss-Newton, positive semi-definite)
//
// and J'J, J'P follow from the clusters in closed form: with m = R'nu, a = mu_k x m, scatter S_k,
// x_k = R mu_k + t,
//
//     J'J   = n [a; nu][a; nu]' + [[m]x S [m]x' 0; 0 0]
//     J'P_j = n [a; nu] u_j.(x_k - mu) - [m x S R'u_j; 0]         J'P_d = -n [a; nu]
//     J'r   = n [a; nu] nu.(x_k - mu)  - [m x S m; 0]
//
// One pass over the clusters; no point is touched. Tangent of a pose: [rotation; translation],
// core/geometry/se3.h. The rows W of backend/bundle/cost.h are (P'P)^-1/2 P'J.
#pragma once

#include <memory>
#include <vector>

#include "backend/bundle/cost.h"
#include "backend/bundle/plane_geometry.h"

namespace lamina {

class CondensedCost final : public BundleCost {
 public:
  // Keeps a reference: the problem must outlive the cost. Throws as BundleIndex. Not thread-safe.
  explicit CondensedCost(const BundleProblem& problem) : problem_(problem), index_(problem) {}

  void Linearise(const std::vector<SE3>& poses, ReducedSystem* system) override;
  void FindGradient(const std::vector<SE3>& poses, ReducedSystem* system) override;
  double Value(const std::vector<SE3>& poses) const override;

  bool MakesRows() const override { return true; }
  void LineariseWithoutRows(const std::vector<SE3>& poses, ReducedSystem* system) override;
  void MakeRows(std::size_t plane, ReducedSystem::Rows* rows) const override;

 private:
  // Of the planes at these poses. Those of the last call are kept: a step that was judged by Value
  // and taken is where the next linearisation is.
  const std::vector<PlaneFrame>& FramesAt(const std::vector<SE3>& poses,
                                          const PoseMatrices& matrices) const;

  const BundleProblem& problem_;
  BundleIndex index_;
  mutable std::vector<SE3> at_;
  mutable std::vector<PlaneFrame> frames_;
  // At the poses of the last LineariseWithoutRows; null if these frames are not of that.
  mutable std::unique_ptr<PoseMatrices> for_rows_;
};

}  // namespace lamina
