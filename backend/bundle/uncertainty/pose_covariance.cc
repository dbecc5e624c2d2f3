#include "backend/bundle/uncertainty/pose_covariance.h"

#include <algorithm>

#include "backend/bundle/condensed_cost.h"
#include "backend/bundle/solver/held_directions.h"
#include "backend/bundle/solver/priors.h"
#include "backend/bundle/uncertainty/selected_inverse.h"

namespace lamina {
namespace {

// The blocks of H that are not zero.
SymmetricBlocks BlocksOf(const BundleProblem& problem, const std::vector<SE3>& poses) {
  const BundleIndex index(problem);
  const BlockPattern pattern(problem, index);
  Eigen::SparseMatrix<double> H;  // its upper triangle
  CondensedCost cost(problem);
  ReducedSystem system;
  cost.LineariseWithoutRows(poses, &system);
  system.AssembleInParts(problem, index, pattern, cost, ReducedSystem::kPart, &H);
  AddPriors(problem, poses, &system.gradient, &H);
  SymmetricBlocks rows;
  for (std::size_t f = 0; f < problem.poses.size(); ++f) {
    rows.columns.push_back(pattern.partners(f));
    rows.blocks.emplace_back();
    for (std::size_t i = 0; i <= pattern.own(f); ++i)
      rows.blocks[f].push_back(pattern.Block(f, i, H).transpose());
  }
  return rows;
}

// Takes the held directions out of H: nothing couples to them, and along them H is `largest` times
// the identity. (A stiffness far above the rest of H would do the same but for its rounding, which
// outweighs what holds the end of a long chain.)
void Uncouple(const std::vector<HeldSpace>& held, double largest, SymmetricBlocks* H) {
  std::vector<Matrix6d> keep;
  for (const HeldSpace& space : held) {
    keep.push_back(Matrix6d::Identity() - space * space.transpose());
  }
  for (std::size_t f = 0; f < held.size(); ++f) {
    for (std::size_t i = 0; i < H->columns[f].size(); ++i) {
      const auto k = static_cast<std::size_t>(H->columns[f][i]);
      if (held[f].cols() == 0 && held[k].cols() == 0) continue;
      H->blocks[f][i] = (keep[f] * H->blocks[f][i] * keep[k]).eval();
    }
    H->blocks[f].back() += largest * held[f] * held[f].transpose();
  }
}

}  // namespace

std::vector<Matrix6d> PoseCovariances(const BundleProblem& problem, const std::vector<SE3>& poses,
                                      double open_variance, std::string* why_none) {
  SymmetricBlocks H = BlocksOf(problem, poses);
  const std::vector<HeldSpace> held = HeldSpaces(problem);
  double largest = 1e-300;
  for (const auto& row : H.blocks) largest = std::max(largest, row.back().diagonal().maxCoeff());
  Uncouple(held, largest, &H);
  std::vector<Matrix6d> covariances;
  const SelectedInverse inverse = InvertOnDiagonal(H, &covariances);
  if (inverse != SelectedInverse::kDone) {
    if (why_none != nullptr) {
      *why_none = inverse == SelectedInverse::kNotPositiveDefinite
                      ? "the normal equations at the solution are not positive definite"
                      : "the normal equations at the solution are all but singular";
    }
    return {};
  }
  for (std::size_t k = 0; k < held.size(); ++k) {
    if (held[k].cols() == 6) {
      covariances[k].setZero();
    } else {
      covariances[k] += (open_variance - 1.0 / largest) * held[k] * held[k].transpose();
    }
  }
  return covariances;
}

}  // namespace lamina
