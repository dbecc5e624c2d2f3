// TEASER++ (Yang, Shi, Carlone, "TEASER: Fast and Certifiable Point Cloud Registration", T-RO
// 2020), scale known to be one.
//
// With matches (a_i, b_i), b_i = R a_i + t + noise of norm <= beta for inliers:
//
//   1. Consistency. Two inliers satisfy | |b_i - b_j| - |a_i - a_j| | <= 2 beta. Matches are the
//      vertices of a graph, consistent pairs its edges; inliers form a clique, the largest is kept.
//   2. Rotation, of the translation-invariant differences of the clique, by truncated least squares
//
//        min_R  sum_k min(r_k^2, c^2),  r_k = |b_ij - R a_ij|,  c = 2 beta
//
//      under graduated non-convexity (their eq. 27-29): with mu from small to large,
//      w_k = 1 below mu/(mu+1) c^2, 0 above (mu+1)/mu c^2, c sqrt(mu (mu+1)) / r_k - mu between;
//      each weighted problem is solved in closed form (Horn, Kabsch).
//   3. Translation, each component on its own, by adaptive voting: t = b_i - R a_i +- beta gives
//      intervals; between any two neighbouring ends the set of intervals is constant, its mean is
//      the estimate, and the one of least truncated cost wins.
//
// The certificate of the paper is not computed.
//
// Private to frontend/pairwise.
#pragma once

#include <memory>
#include <vector>

#include "frontend/pairwise/feature_matching.h"
#include "frontend/pairwise/pairwise_registration.h"

namespace lamina {

std::unique_ptr<PairwiseMethod> MakeTeaser(const PairwiseOptions& options);

// From matches; `noise_m` is beta. Refused with fewer than `min_consistent` inliers.
PairwiseResult SolveTeaser(const std::vector<FeatureMatch>& matches, double noise_m,
                           int min_consistent);

// The rotation R that minimises sum_k w_k |b_k - R a_k|^2.
Eigen::Matrix3d WeightedRotation(const std::vector<FeatureMatch>& differences,
                                 const std::vector<double>& weights);

// Step 3 for one component: `values` are those of b - R a.
double VoteAdaptively(const std::vector<double>& values, double bound);

}  // namespace lamina
