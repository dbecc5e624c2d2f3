// The blocks on the diagonal of the inverse of a sparse symmetric matrix, without the rest of it.
//
// With A = L L' in blocks, Z = A^-1 obeys Z L = L^-T, whose right side is upper triangular. Read
// column by column from the last one, that gives (Takahashi, Fagan and Chen 1973)
//
//     Z_ij = - sum_{k > j} Z_ik Y_k,                           i > j,    Y_k = L_kj L_jj^-1
//     Z_jj = (L_jj L_jj')^-1 - sum_{k > j} Z_kj' Y_k
//
// where k runs over the blocks of column j that are not zero, and all Z_ik that are asked for lie
// where L has a block. So the cost is that of a factorisation or two, and the memory that of L, in
// an order of the rows that keeps L sparse (approximate minimum degree).
#pragma once

#include <cstdint>
#include <vector>

#include "core/geometry/se3.h"

namespace lamina {

// The blocks on and below the diagonal of a symmetric matrix of 6x6 blocks that are not zero.
struct SymmetricBlocks {
  std::vector<std::vector<std::int32_t>> columns;  // of each row, ascending; the last is the row
  std::vector<std::vector<Matrix6d>> blocks;       // of these columns
};

// The diagonal blocks of A^-1 go to *inverse. False, and *inverse empty, if A is not positive
// definite, up to rounding. Thread-safe. May throw std::bad_alloc.
bool InvertOnDiagonal(const SymmetricBlocks& A, std::vector<Matrix6d>* inverse);

}  // namespace lamina
