#include "backend/bundle/held_directions.h"

#include <algorithm>

namespace lamina {

std::vector<HeldSpace> HeldSpaces(const BundleProblem& problem, const Vector6d& scale) {
  std::vector<HeldSpace> spaces(problem.poses.size(), HeldSpace(6, 0));
  const auto add = [&](int frame, const Vector6d& direction) {
    HeldSpace& space = spaces.at(static_cast<std::size_t>(frame));
    Vector6d v = scale.cwiseProduct(direction).normalized();
    v -= space * (space.transpose() * v);
    constexpr double kNothingNew = 1e-6;
    if (space.cols() == 6 || v.norm() < kNothingNew) return;
    space.conservativeResize(Eigen::NoChange, space.cols() + 1);
    space.col(space.cols() - 1) = v.normalized();
  };
  for (const HeldDirection& hold : problem.holds) add(hold.frame, hold.direction);
  if (problem.hold_first_pose && !spaces.empty()) {
    for (int i = 0; i < 6; ++i) add(0, Vector6d::Unit(i));
  }
  return spaces;
}

HeldDirections::HeldDirections(const BundleProblem& problem) {
  const std::vector<HeldSpace> spaces = HeldSpaces(problem);
  for (std::size_t k = 0; k < spaces.size(); ++k) {
    if (spaces[k].cols() == 0) continue;
    Matrix6d projector = Matrix6d::Zero();
    if (spaces[k].cols() < 6) {
      projector = Matrix6d::Identity() - spaces[k] * spaces[k].transpose();
    }
    frames_.push_back({k, spaces[k], projector});
  }
}

void HeldDirections::TakeOut(Eigen::MatrixXd* H) const {
  if (frames_.empty()) return;
  const double largest = H->diagonal().maxCoeff();
  for (const Frame& f : frames_) {
    const auto i = static_cast<Eigen::Index>(6 * f.frame);
    H->middleRows<6>(i) = (f.projector * H->middleRows<6>(i)).eval();
    H->middleCols<6>(i) = (H->middleCols<6>(i) * f.projector).eval();
    H->block<6, 6>(i, i) += largest * f.space * f.space.transpose();
  }
}

void HeldDirections::TakeOut(std::vector<Matrix6d>* diagonal) const {
  double largest = 0.0;
  for (const Matrix6d& block : *diagonal) largest = std::max(largest, block.diagonal().maxCoeff());
  for (const Frame& f : frames_) {
    Matrix6d& block = (*diagonal)[f.frame];
    block = (f.projector * block * f.projector).eval();
    block += largest * f.space * f.space.transpose();
  }
}

Eigen::SparseMatrix<double> HeldDirections::TakenOut(const Eigen::SparseMatrix<double>& H) const {
  if (frames_.empty()) return H;
  const double largest = H.diagonal().maxCoeff();
  // Blocks of 6x6 with all their entries, so that the structure of the product is that of H.
  std::vector<Eigen::Triplet<double>> P, held;
  const auto add = [](const Frame& f, const Matrix6d& block,
                      std::vector<Eigen::Triplet<double>>* all) {
    const auto i = static_cast<Eigen::Index>(6 * f.frame);
    for (Eigen::Index c = 0; c < 6; ++c) {
      for (Eigen::Index r = 0; r < 6; ++r) all->emplace_back(i + r, i + c, block(r, c));
    }
  };
  std::vector<bool> free(static_cast<std::size_t>(H.cols() / 6), true);
  for (const Frame& f : frames_) {
    free[f.frame] = false;
    add(f, f.projector, &P);
    add(f, largest * f.space * f.space.transpose(), &held);
  }
  for (Eigen::Index i = 0; i < H.cols(); ++i) {
    if (free[static_cast<std::size_t>(i / 6)]) P.emplace_back(i, i, 1.0);
  }
  Eigen::SparseMatrix<double> projector(H.rows(), H.cols()), stiff(H.rows(), H.cols());
  projector.setFromTriplets(P.begin(), P.end());
  stiff.setFromTriplets(held.begin(), held.end());
  const Eigen::SparseMatrix<double> all = H.selfadjointView<Eigen::Upper>();
  const Eigen::SparseMatrix<double> projected = projector * all * projector;
  const Eigen::SparseMatrix<double> sum = projected + stiff;
  return sum.triangularView<Eigen::Upper>();
}

}  // namespace lamina
