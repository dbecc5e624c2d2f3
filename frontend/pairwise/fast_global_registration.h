// Fast global registration (Zhou, Park, Koltun, ECCV 2016).
//
// Matches are mutual nearest neighbours in feature space, then go through the tuple test: of three
// random matches, all lengths |a_i - a_j| / |b_i - b_j| must lie within [0.9, 1/0.9]; matches of
// tuples that pass are kept. The pose then minimises, under the scaled Geman-McClure kernel,
//
//     E(T) = sum_k rho(|b_k - T a_k|),   rho(x) = mu x^2 / (mu + x^2),
//
// by Gauss-Newton with the weights l_k = (mu / (mu + x_k^2))^2 of their line process (eq. 4-6), mu
// (m^2) lowered from the square of the scene's size to that of the noise every fourth step.
//
// Private to frontend/pairwise.
#pragma once

#include <memory>
#include <vector>

#include "frontend/pairwise/feature_matching.h"
#include "frontend/pairwise/pairwise_registration.h"

namespace lamina {

std::unique_ptr<PairwiseMethod> MakeFastGlobalRegistration(const PairwiseOptions& options);

// From matches that have passed the tests. Refused with fewer than `min_consistent` of them within
// 2 noise_m at the end.
PairwiseResult SolveFastGlobal(const std::vector<FeatureMatch>& matches, double noise_m,
                               int min_consistent);

// The tuple test, on triples drawn from a fixed seed; matches in the order in which they passed,
// each once.
std::vector<FeatureMatch> TupleTest(const std::vector<FeatureMatch>& matches);

}  // namespace lamina
