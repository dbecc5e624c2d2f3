#include "backend/bundle/solver/held_directions.h"

#include <algorithm>
#include <cstdint>

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

void HeldDirections::TakeOut(const BlockPattern& pattern, Eigen::SparseMatrix<double>* H) const {
  if (frames_.empty()) return;
  const double largest = H->diagonal().maxCoeff();
  std::vector<const Frame*> held(pattern.frames(), nullptr);
  for (const Frame& f : frames_) held[f.frame] = &f;
  for (std::size_t f = 0; f < held.size(); ++f) {
    const std::vector<std::int32_t>& partners = pattern.partners(f);
    for (std::size_t i = 0; i < partners.size(); ++i) {
      const Frame* const other = held[static_cast<std::size_t>(partners[i])];
      if (held[f] == nullptr && other == nullptr) continue;
      const bool own = i == pattern.own(f);
      Matrix6d block = pattern.Block(f, i, *H);
      if (other != nullptr) block = (other->projector * block).eval();
      if (held[f] != nullptr) block = (block * held[f]->projector).eval();
      if (own) block += largest * held[f]->space * held[f]->space.transpose();
      for (int c = 0; c < 6; ++c) {
        const int rows = own ? c + 1 : 6;
        for (int r = 0; r < rows; ++r) BlockPattern::Entry(f, i, r, c, H) = block(r, c);
      }
    }
  }
}

}  // namespace lamina
