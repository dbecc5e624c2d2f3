// Voxelised GICP (Koide, Yokozuka, Oishi, Banno, ICRA 2021): distribution to distribution without
// nearest-neighbour search.
//
// The target's points lie in a voxel hash; voxel v has n_v points of mean mu_v and a covariance
// C_v, the mean of its points'. A source point p_i of covariance C_i meets the voxel around T p_i,
// and
//
//     E(T) = sum_i n_v d' (C_v + R C_i R')^-1 d,   d = mu_v - T p_i                        (eq. 15)
//
// is minimised by Gauss-Newton, the inverse held during a step. Covariances have the eigenvalues
// (1, 1, 1e-3) of a plane. Where the paper takes a point's covariance from its nearest neighbours,
// here it is that of the point cluster of its voxel: one hash look-up again, and no tree at all.
// n_v is capped, or near and dense voxels would outvote all others.
//
// Private to frontend/pairwise.
#pragma once

#include <memory>

#include "frontend/pairwise/pairwise_registration.h"

namespace lamina {

std::unique_ptr<PairwiseMethod> MakeVoxelizedGicp(const PairwiseOptions& options);

}  // namespace lamina
