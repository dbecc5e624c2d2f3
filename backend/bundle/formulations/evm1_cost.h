// Formulation `evm1`: the smallest eigenvalue point by point, second order (BALM: Liu and Zhang,
// "BALM: Bundle Adjustment for Lidar Mapping", RA-L 2021).
//
// The cost is that of `condensed`, but taken as a function of the points x_i = R_k p_i + t_k:
//
//     C(x) ~ C + (dC/dx) D delta + 1/2 delta' D' (d2C/dx2) D delta,     D_i = [-R [p_i]x   I]
//
// with the exact second derivative of lambda_3 by the points, and the curvature of x_i in the pose
// neglected, as in that paper. d2C/dx2 is of rank 3 a plane beside its diagonal, so that the sums
//
//     D_k = sum D_i' nu nu' D_i,   W_pk = sum [ (u_j . x_i) D_i' nu + (nu . x_i) D_i' u_j ] ..
//
// run over the points of a frame once: linear in the points, which is what this formulation is here
// to show. It needs BundleProblem::points.
//
// Private to backend/bundle/formulations.
#pragma once

#include "backend/bundle/cost.h"
#include "backend/bundle/plane_geometry.h"
#include "backend/bundle/solver/formulation.h"

namespace lamina {

class Evm1Cost final : public BundleCost {
 public:
  // Keeps a reference: the problem must outlive the cost. Throws std::logic_error if the problem
  // carries no points, or planes with a fixed cluster (whose points are gone), and as BundleIndex.
  explicit Evm1Cost(const BundleProblem& problem);

  void Linearise(const std::vector<SE3>& poses, ReducedSystem* system) override;
  double Value(const std::vector<SE3>& poses) const override;

 private:
  std::vector<PlaneFrame> Frames(const PoseMatrices& poses) const;

  const BundleProblem& problem_;
  BundleIndex index_;
};

const Formulation& Evm1Formulation();

}  // namespace lamina
