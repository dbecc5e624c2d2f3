// Which frames see planes together or have a prior between them: the 6x6 blocks of the normal
// equations that are not zero.
//
// A matrix H of these blocks is kept as its upper triangle, compressed by columns: column c of a
// frame has six rows of each of its partners, then rows 0 to c of its own.
#pragma once

#include <Eigen/SparseCore>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "backend/bundle/index.h"
#include "backend/bundle/problem.h"

namespace lamina {

class BlockPattern {
 public:
  BlockPattern(const BundleProblem& problem, const BundleIndex& index);
  // partners[f]: as partners(f) below.
  explicit BlockPattern(std::vector<std::vector<std::int32_t>> partners)
      : partners_(std::move(partners)) {}
  std::size_t frames() const { return partners_.size(); }
  // Frames k <= frame that share a plane or a prior with it, ascending; itself is the last.
  const std::vector<std::int32_t>& partners(std::size_t frame) const { return partners_[frame]; }
  // Position of itself among them.
  std::size_t own(std::size_t frame) const { return partners_[frame].size() - 1; }
  // Share of the blocks on and below the diagonal that are not zero.
  double Density() const;

  // An H of zeros.
  Eigen::SparseMatrix<double> Zeros() const;
  // Entry (r, c) of the block of a frame's i-th partner (rows) and itself (columns); r <= c if that
  // is its own.
  static double& Entry(std::size_t frame, std::size_t i, int r, int c,
                       Eigen::SparseMatrix<double>* H) {
    return H->valuePtr()[Offset(frame, i, r, c, *H)];
  }
  // The whole block.
  Matrix6d Block(std::size_t frame, std::size_t i, const Eigen::SparseMatrix<double>& H) const;

 private:
  static int Offset(std::size_t frame, std::size_t i, int r, int c,
                    const Eigen::SparseMatrix<double>& H) {
    return H.outerIndexPtr()[6 * frame + static_cast<std::size_t>(c)] + 6 * static_cast<int>(i) + r;
  }

  std::vector<std::vector<std::int32_t>> partners_;
};

}  // namespace lamina
