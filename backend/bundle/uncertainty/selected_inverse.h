// Blocks of the inverse of a sparse symmetric matrix, those on the diagonal or wherever the matrix
// has one, without the rest of it.
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
//
// Rounding. Only one of Z_ik and Z_ki is stored, so an antisymmetric part of a Z_kk, which no
// Z_ik mirrors, is not carried on by the same products as a symmetric one: where those nearly
// cancel (a chain whose frames are extrapolated from two neighbours: Y of 2 and -1), it grows
// several times over with each column. Therefore each Z_jj is made symmetric when it is found; a
// symmetric error grows no faster than Z does. What is left is seen in A Z - I, of which the blocks
// on the diagonal take no other blocks of Z than those at hand.
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

enum class SelectedInverse {
  kDone,
  kNotPositiveDefinite,  // up to rounding
  // A Z differs from I by 1e-3 and more on its diagonal, or a block of Z is not positive definite:
  // A is all but singular.
  kInaccurate,
};

// The diagonal blocks of A^-1 go to *inverse, symmetric and positive definite; it is empty if
// anything but kDone is returned. Thread-safe. May throw std::bad_alloc.
SelectedInverse InvertOnDiagonal(const SymmetricBlocks& A, std::vector<Matrix6d>* inverse);
// The same, of all blocks of A^-1 where A has one, in that order.
SelectedInverse InvertOnPattern(const SymmetricBlocks& A, SymmetricBlocks* inverse);

}  // namespace lamina
