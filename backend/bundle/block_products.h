// The products of the Schur complement: H_jk -= sum_p W_pj' W_pk, where most of the time of a large
// adjustment goes.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/geometry/se3.h"

namespace lamina {

// W_pk of an observation. Row-major: the six numbers of one plane variable lie together.
using PlaneRows = Eigen::Matrix<double, 3, 6, Eigen::RowMajor>;

// block_k -= mine' rows_k for each of `count` rows, `mine` being the last of them; blocks are 6x6,
// column-major, at strip + 36 frames[k]. Each entry is (a0 b0 + a1 b1) + a2 b2, in this order and
// without fused operations, with AVX where the processor has it: the same bits everywhere.
void SubtractProducts(const PlaneRows* rows, const std::int32_t* frames, std::size_t count,
                      double* strip);

}  // namespace lamina
