// Cholesky factorisation of sparse normal equations in 6x6 blocks: CHOLMOD, supernodal.
//
// The order of elimination is found on the graph of the frames, 36 times smaller than that of the
// unknowns: approximate minimum degree or nested dissection (METIS), whichever fills less. A drive
// through streets is a chain with few loops, so its factor stays close to the matrix itself.
//
//     cost    that of dense blocks where frames see planes together, nothing elsewhere
//     bits    one thread, one order: the same at any number of threads of the caller (as long as
//             the installed BLAS does not itself share out a product by its own threads)
//
// Not thread-safe; different objects may be used at once.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <memory>

#include "backend/bundle/block_pattern.h"
#include "backend/bundle/solver/held_directions.h"

namespace lamina {

class SparseCholesky {
 public:
  SparseCholesky();
  ~SparseCholesky();
  SparseCholesky(const SparseCholesky&) = delete;
  SparseCholesky& operator=(const SparseCholesky&) = delete;

  // Finds the order. Returns the multiplications that a factorisation takes, as a share of those of
  // a dense one; more than 1 if there is no order (out of memory).
  double Order(const BlockPattern& pattern);
  // Factorises the upper triangle of a matrix with the structure of that pattern. False if it is
  // not positive definite, or too large.
  bool Factorise(const Eigen::SparseMatrix<double>& upper);
  // The same of H, which has this pattern, with this damping of the unknowns; H is as before then.
  bool FactoriseDamped(const BlockPattern& pattern, const HeldDirections& held,
                       const Eigen::VectorXd& damping, Eigen::SparseMatrix<double>* H);
  // After a Factorise that was true.
  Eigen::VectorXd Solve(const Eigen::VectorXd& right_side);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lamina
