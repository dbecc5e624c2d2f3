#include "backend/bundle/uncertainty/selected_inverse.h"

#include <Eigen/Cholesky>
#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>
#include <limits>
#include <utility>

namespace lamina {
namespace {

// The place of each row in the order of elimination.
std::vector<std::int32_t> EliminationOrder(const SymmetricBlocks& A) {
  const auto size = static_cast<int>(A.columns.size());
  std::vector<Eigen::Triplet<double>> entries;
  for (int row = 0; row < size; ++row) {
    for (const std::int32_t column : A.columns[static_cast<std::size_t>(row)]) {
      entries.emplace_back(row, column, 1.0);
      if (column != row) entries.emplace_back(column, row, 1.0);
    }
  }
  Eigen::SparseMatrix<double> pattern(size, size);
  pattern.setFromTriplets(entries.begin(), entries.end());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;  // old index of each place
  Eigen::AMDOrdering<int>()(pattern, order);
  std::vector<std::int32_t> place(A.columns.size());
  for (int i = 0; i < size; ++i) place[static_cast<std::size_t>(order.indices()(i))] = i;
  return place;
}

// Column j of L, then of Z: the block on the diagonal, and those below it that are not zero.
struct Column {
  std::vector<std::int32_t> rows;  // ascending
  std::vector<Matrix6d> blocks;
  Matrix6d diagonal = Matrix6d::Zero();

  std::size_t Find(std::int32_t row) const {
    return static_cast<std::size_t>(std::lower_bound(rows.begin(), rows.end(), row) - rows.begin());
  }
};

class SparseFactor {
 public:
  explicit SparseFactor(const SymmetricBlocks& A)
      : place_(EliminationOrder(A)), columns_(A.columns.size()), at_(A.columns.size(), -1) {
    MakeStructure(A);
    Fill(A);
  }

  // False if the matrix is not positive definite.
  bool Factorise() {
    for (Column& column : columns_) {
      const Eigen::LLT<Matrix6d> llt(column.diagonal);
      if (llt.info() != Eigen::Success || !column.diagonal.allFinite()) return false;
      column.diagonal = llt.matrixL();
      for (Matrix6d& block : column.blocks) {
        column.diagonal.triangularView<Eigen::Lower>().transpose().solveInPlace<Eigen::OnTheRight>(
            block);
      }
      SubtractProducts(column);
    }
    return true;
  }

  // From L to Z, column by column from the last one.
  void Invert() {
    for (auto column = columns_.rbegin(); column != columns_.rend(); ++column) {
      const Matrix6d inverse =
          column->diagonal.triangularView<Eigen::Lower>().solve(Matrix6d::Identity());
      std::vector<Matrix6d> Y = column->blocks;
      for (Matrix6d& block : Y) block = (block * inverse).eval();
      MultiplyByInverse(Y, column->rows, &column->blocks);
      column->diagonal.noalias() = inverse.transpose() * inverse;
      for (std::size_t i = 0; i < Y.size(); ++i) {
        column->diagonal.noalias() -= column->blocks[i].transpose() * Y[i];
      }
      // Rounding leaves an antisymmetric part, which would grow from column to column: see the
      // header.
      column->diagonal = (0.5 * (column->diagonal + column->diagonal.transpose())).eval();
    }
  }

  // Largest entry of A Z - I over its blocks on the diagonal, after Invert. Z has every block that
  // they take.
  double ResidualOf(const SymmetricBlocks& A) const {
    std::vector<Matrix6d> residuals(place_.size(), -Matrix6d::Identity());
    for (std::size_t row = 0; row < A.columns.size(); ++row) {
      for (std::size_t i = 0; i < A.columns[row].size(); ++i) {
        const auto other = static_cast<std::size_t>(A.columns[row][i]);
        const Matrix6d& block = A.blocks[row][i];
        const Matrix6d Z = Block(place_[row], place_[other]);
        residuals[row].noalias() += block * Z.transpose();
        if (other != row) residuals[other].noalias() += block.transpose() * Z;
      }
    }
    double largest = 0.0;
    for (const Matrix6d& residual : residuals) {
      if (!residual.allFinite()) return std::numeric_limits<double>::infinity();
      largest = std::max(largest, residual.cwiseAbs().maxCoeff());
    }
    return largest;
  }

  // Of Z, where A has blocks.
  SymmetricBlocks On(const SymmetricBlocks& A) const {
    SymmetricBlocks Z{A.columns, {}};
    for (std::size_t row = 0; row < A.columns.size(); ++row) {
      Z.blocks.emplace_back();
      for (const std::int32_t column : A.columns[row])
        Z.blocks.back().push_back(Block(place_[row], place_[static_cast<std::size_t>(column)]));
    }
    return Z;
  }
  std::vector<Matrix6d> Diagonal() const {
    std::vector<Matrix6d> blocks;
    blocks.reserve(place_.size());
    for (const std::int32_t place : place_) {
      blocks.push_back(columns_[static_cast<std::size_t>(place)].diagonal);
    }
    return blocks;
  }

 private:
  Column& At(std::int32_t place) { return columns_[static_cast<std::size_t>(place)]; }

  // The block (row, column), which is not zero, by place.
  Matrix6d Block(std::int32_t row, std::int32_t column) const {
    const Column& low = columns_[static_cast<std::size_t>(std::min(row, column))];
    if (row == column) return low.diagonal;
    const Matrix6d& block = low.blocks[low.Find(std::max(row, column))];
    return row > column ? block : Matrix6d(block.transpose());
  }

  // Rows of column j: those of A, and those of each column whose first row is j.
  void MakeStructure(const SymmetricBlocks& A) {
    for (std::size_t row = 0; row < A.columns.size(); ++row) {
      for (const std::int32_t column : A.columns[row]) {
        const auto [low, high] = std::minmax(place_[row], place_[static_cast<std::size_t>(column)]);
        if (low != high) At(low).rows.push_back(high);
      }
    }
    for (Column& column : columns_) {
      std::sort(column.rows.begin(), column.rows.end());
      column.rows.erase(std::unique(column.rows.begin(), column.rows.end()), column.rows.end());
      column.blocks.assign(column.rows.size(), Matrix6d::Zero());
      if (column.rows.empty()) continue;
      std::vector<std::int32_t>& parent = At(column.rows.front()).rows;
      parent.insert(parent.end(), column.rows.begin() + 1, column.rows.end());
    }
  }

  void Fill(const SymmetricBlocks& A) {
    for (std::size_t row = 0; row < A.columns.size(); ++row) {
      for (std::size_t i = 0; i < A.columns[row].size(); ++i) {
        const std::int32_t r = place_[row], c = place_[static_cast<std::size_t>(A.columns[row][i])];
        const Matrix6d& block = A.blocks[row][i];
        if (r == c) {
          At(r).diagonal = block;
        } else {
          Column& column = At(std::min(r, c));
          column.blocks[column.Find(std::max(r, c))] = r > c ? block : Matrix6d(block.transpose());
        }
      }
    }
  }

  // Calls visit(i, k, block) for all i >= k of these rows, with the block (rows[i], rows[k]).
  template <typename Visit>
  void VisitPairs(const std::vector<std::int32_t>& rows, const Visit& visit) {
    for (std::size_t k = 0; k < rows.size(); ++k) {
      Column& column = At(rows[k]);
      visit(k, k, &column.diagonal);
      // Where the column has what: it has at least the rows that follow.
      for (std::size_t i = 0; i < column.rows.size(); ++i) {
        at_[static_cast<std::size_t>(column.rows[i])] = static_cast<std::int32_t>(i);
      }
      for (std::size_t i = k + 1; i < rows.size(); ++i) {
        visit(i, k,
              &column.blocks[static_cast<std::size_t>(at_[static_cast<std::size_t>(rows[i])])]);
      }
    }
  }

  // A_ik -= L_ij L_kj', for the column j.
  void SubtractProducts(const Column& j) {
    VisitPairs(j.rows, [&](std::size_t i, std::size_t k, Matrix6d* block) {
      block->noalias() -= j.blocks[i] * j.blocks[k].transpose();
    });
  }

  // Z_i = - sum_k Z_ik Y_k over these rows.
  void MultiplyByInverse(const std::vector<Matrix6d>& Y, const std::vector<std::int32_t>& rows,
                         std::vector<Matrix6d>* Z) {
    for (Matrix6d& block : *Z) block.setZero();
    VisitPairs(rows, [&](std::size_t i, std::size_t k, const Matrix6d* block) {
      (*Z)[i].noalias() -= *block * Y[k];
      if (i != k) (*Z)[k].noalias() -= block->transpose() * Y[i];
    });
  }

  std::vector<std::int32_t> place_;  // of each row of A
  std::vector<Column> columns_;      // by place
  std::vector<std::int32_t> at_;
};

// Z of a factor of A, judged.
SelectedInverse Invert(const SymmetricBlocks& A, SparseFactor* factor) {
  constexpr double kMostResidual = 1e-3;
  if (!factor->Factorise()) return SelectedInverse::kNotPositiveDefinite;
  factor->Invert();
  if (!(factor->ResidualOf(A) < kMostResidual)) return SelectedInverse::kInaccurate;
  for (const Matrix6d& block : factor->Diagonal()) {
    if (Eigen::LLT<Matrix6d>(block).info() != Eigen::Success) return SelectedInverse::kInaccurate;
  }
  return SelectedInverse::kDone;
}

}  // namespace

SelectedInverse InvertOnDiagonal(const SymmetricBlocks& A, std::vector<Matrix6d>* inverse) {
  inverse->clear();
  SparseFactor factor(A);
  const SelectedInverse result = Invert(A, &factor);
  if (result == SelectedInverse::kDone) *inverse = factor.Diagonal();
  return result;
}

SelectedInverse InvertOnPattern(const SymmetricBlocks& A, SymmetricBlocks* inverse) {
  *inverse = {};
  SparseFactor factor(A);
  const SelectedInverse result = Invert(A, &factor);
  if (result == SelectedInverse::kDone) *inverse = factor.On(A);
  return result;
}

}  // namespace lamina
