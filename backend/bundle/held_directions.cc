#include "backend/bundle/held_directions.h"

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

void StiffenHeld(const HeldSpace& held, double largest,
                 Eigen::Ref<Matrix6d, 0, Eigen::OuterStride<>> block) {
  block.diagonal().array() += 1e-14 * largest;
  block += 1e8 * largest * held * held.transpose();
}

}  // namespace lamina
