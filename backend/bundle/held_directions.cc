#include "backend/bundle/held_directions.h"

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

void HeldDirections::TakeOut(const BundleProblem& problem, ReducedSystem* system) const {
  if (frames_.empty()) return;
  double largest = 0.0;
  for (const Matrix6d& block : system->diagonal) {
    largest = std::max(largest, block.diagonal().maxCoeff());
  }
  constexpr std::int32_t kFree = -1;
  std::vector<std::int32_t> held(system->diagonal.size(), kFree);
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    const Frame& f = frames_[i];
    held[f.frame] = static_cast<std::int32_t>(i);
    Matrix6d& block = system->diagonal[f.frame];
    block = (f.projector * block * f.projector).eval();
    block += largest * f.space * f.space.transpose();
  }
  for (std::size_t o = 0; o < system->rows.size(); ++o) {
    const std::int32_t i = held[static_cast<std::size_t>(problem.observations[o].frame)];
    if (i == kFree) continue;
    system->rows[o] = (system->rows[o] * frames_[static_cast<std::size_t>(i)].projector).eval();
  }
  Project(&system->gradient);
}

}  // namespace lamina
