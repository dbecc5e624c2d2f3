#include "backend/anchors/loop_innovation.h"

#include <Eigen/Eigenvalues>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "backend/bundle/uncertainty/selected_inverse.h"

namespace lamina {
namespace {

// A = sum J'J of edges, in blocks of poses.
class NormalBlocks {
 public:
  // With room for what any of these may add.
  explicit NormalBlocks(const std::vector<LinearEdge>& edges) {
    for (const LinearEdge& edge : edges) {
      for (const LinearEdge::End& end : edge.ends) {
        if (end.pose >= static_cast<int>(A_.columns.size()))
          A_.columns.resize(static_cast<std::size_t>(end.pose) + 1);
      }
    }
    for (std::size_t row = 0; row < A_.columns.size(); ++row)
      A_.columns[row].push_back(static_cast<std::int32_t>(row));
    for (const LinearEdge& edge : edges) {
      const auto [low, high] = std::minmax(edge.ends[0].pose, edge.ends[1].pose);
      if (low >= 0 && low != high) A_.columns[static_cast<std::size_t>(high)].push_back(low);
    }
    // What no edge holds yet is known to some kilometres.
    constexpr double kDamping = 1e-8;
    for (std::vector<std::int32_t>& columns : A_.columns) {
      std::sort(columns.begin(), columns.end());
      columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
      A_.blocks.emplace_back(columns.size(), Matrix6d::Zero());
      A_.blocks.back().back() = kDamping * Matrix6d::Identity();
    }
  }

  void Add(const LinearEdge& edge) {
    for (const LinearEdge::End& a : edge.ends) {
      for (const LinearEdge::End& b : edge.ends) {
        if (a.pose >= b.pose && b.pose >= 0) Block(&A_, a.pose, b.pose) += a.J.transpose() * b.J;
      }
    }
  }

  // J A^-1 J' of each of these edges from the given one on.
  std::vector<Matrix6d> Predicted(const std::vector<LinearEdge>& edges, std::size_t first) const {
    SymmetricBlocks inverse;
    const bool selected = InvertOnPattern(A_, &inverse) == SelectedInverse::kDone;
    // What hangs by the damping alone is too far from the rest for the selected inverse.
    Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor;
    if (!selected) factor.compute(Sparse());
    std::vector<Matrix6d> predicted;
    for (std::size_t i = first; i < edges.size(); ++i)
      predicted.push_back(selected ? Spread(edges[i], &inverse) : SolvedSpread(edges[i], factor));
    return predicted;
  }

 private:
  static Matrix6d& Block(SymmetricBlocks* blocks, int row, int column) {
    const auto at = static_cast<std::size_t>(row);
    const std::vector<std::int32_t>& columns = blocks->columns[at];
    const auto found = std::lower_bound(columns.begin(), columns.end(), column);
    return blocks->blocks[at][static_cast<std::size_t>(found - columns.begin())];
  }

  static Matrix6d Spread(const LinearEdge& edge, SymmetricBlocks* inverse) {
    Matrix6d spread = Matrix6d::Zero();
    for (const LinearEdge::End& a : edge.ends) {
      for (const LinearEdge::End& b : edge.ends) {
        if (a.pose < b.pose || b.pose < 0) continue;
        const Matrix6d part = a.J * Block(inverse, a.pose, b.pose) * b.J.transpose();
        spread += part;
        if (a.pose != b.pose) spread += part.transpose();
      }
    }
    return spread;
  }

  template <typename Factor>
  Matrix6d SolvedSpread(const LinearEdge& edge, const Factor& factor) const {
    const auto rows = static_cast<Eigen::Index>(6 * A_.columns.size());
    Eigen::MatrixXd Jt = Eigen::MatrixXd::Zero(rows, 6);
    for (const LinearEdge::End& end : edge.ends) {
      if (end.pose >= 0) Jt.middleRows<6>(6 * end.pose) = end.J.transpose();
    }
    return Jt.transpose() * factor.solve(Jt);
  }

  // Its lower triangle.
  Eigen::SparseMatrix<double> Sparse() const {
    std::vector<Eigen::Triplet<double>> entries;
    for (std::size_t row = 0; row < A_.columns.size(); ++row) {
      for (std::size_t i = 0; i < A_.columns[row].size(); ++i) {
        for (int r = 0; r < 6; ++r) {
          for (int c = 0; c < 6; ++c) {
            entries.emplace_back(6 * static_cast<int>(row) + r, 6 * A_.columns[row][i] + c,
                                 A_.blocks[row][i](r, c));
          }
        }
      }
    }
    const auto size = static_cast<Eigen::Index>(6 * A_.columns.size());
    Eigen::SparseMatrix<double> A(size, size);
    A.setFromTriplets(entries.begin(), entries.end());
    return A;
  }

  SymmetricBlocks A_;
};

Innovation InnovationOf(const Vector6d& residual, const Matrix6d& predicted, bool kept) {
  const Matrix6d S = Matrix6d::Identity() + (kept ? Matrix6d(-predicted) : predicted);
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(Matrix6d(0.5 * (S + S.transpose())));
  const Vector6d r = eigen.eigenvectors().transpose() * residual;
  // Along what nothing else determines, a loop that counts cannot be contradicted.
  constexpr double kLeast = 1e-9;
  Innovation innovation;
  for (int k = 0; k < 6; ++k) {
    if (eigen.eigenvalues()(k) < kLeast) continue;
    innovation.square += r(k) * r(k) / eigen.eigenvalues()(k);
    innovation.uncertainty += std::log(eigen.eigenvalues()(k));
  }
  return innovation;
}

}  // namespace

std::vector<Innovation> LoopInnovations(const std::vector<LinearEdge>& edges,
                                        std::size_t first_loop, const std::vector<bool>& kept) {
  NormalBlocks A(edges);
  for (std::size_t i = 0; i < edges.size(); ++i) {
    if (i < first_loop || kept[i - first_loop]) A.Add(edges[i]);
  }
  const std::vector<Matrix6d> predicted = A.Predicted(edges, first_loop);
  std::vector<Innovation> innovations;
  for (std::size_t i = 0; i < predicted.size(); ++i)
    innovations.push_back(InnovationOf(edges[first_loop + i].residual, predicted[i], kept[i]));
  return innovations;
}

}  // namespace lamina
