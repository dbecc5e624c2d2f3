// Correspondences between two scans by their features: what fgr and teaser both start from.
//
// Private to frontend/pairwise.
#pragma once

#include <vector>

#include "frontend/pairwise/pairwise_registration.h"

namespace lamina {

struct FeatureMatch {
  Eigen::Vector3d source, target;
};

// Pairs of feature points each of which is the other's nearest in feature space, those kept whose
// nearest is most distinct from the second nearest (smallest ratio), at most `most`, in the order
// of the source's points. Exact (no approximate search). Both clouds must have features.
std::vector<FeatureMatch> MutualMatches(const PairwiseCloud& source, const PairwiseCloud& target,
                                        std::size_t most);

// Prepares the features of a cloud. Clears them if its surfaces do not face all directions: on
// planes alone motion along them cannot be seen, and matches would be made of noise.
void PrepareFeatures(const PairwiseOptions& options, PairwiseCloud* cloud);

// Reason why features of these clouds cannot be matched; empty if they can.
std::string FeatureFault(const PairwiseCloud& source, const PairwiseCloud& target);

}  // namespace lamina
