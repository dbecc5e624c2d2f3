// Formulation `huang`: the paper's objective as printed (Huang et al., RA-L 2021, eq. 9 and 10).
//
//     1/2 sum_planes weight sum_k  n_k l1_k (nu . R_k u1_k)^2 + n_k l2_k (nu . R_k u2_k)^2
//                                  + n_k (nu . (R_k mu_k + t_k - mu))^2
//
// with l, u the eigenpairs of frame k's cluster. nu and mu, the plane of the aggregate, are held
// during a step and refreshed after it, so the frames decouple (no rows W): a step is cheap, and
// there are many of them. Its weights are l1, l2; the eigenvalue cost that `condensed` minimises
// has l1 - l3, l2 - l3, and the two optima differ by a little where the clusters are noisy.
//
// Private to backend/bundle/formulations.
#pragma once

#include "backend/bundle/cost.h"
#include "backend/bundle/plane_geometry.h"
#include "backend/bundle/solver/formulation.h"

namespace lamina {

class HuangCost final : public BundleCost {
 public:
  // Keeps a reference: the problem must outlive the cost. Throws as BundleIndex.
  explicit HuangCost(const BundleProblem& problem);

  void Linearise(const std::vector<SE3>& poses, ReducedSystem* system) override;
  double Value(const std::vector<SE3>& poses) const override;

 private:
  const BundleProblem& problem_;
  BundleIndex index_;
  // sqrt(n l1) u1 and sqrt(n l2) u2 of each observation.
  std::vector<Eigen::Matrix<double, 3, 2>> axes_;
  std::vector<PlaneFrame> held_;
};

const Formulation& HuangFormulation();

}  // namespace lamina
