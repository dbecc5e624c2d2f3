#include "backend/registration/put_back.h"

#include <Eigen/QR>
#include <algorithm>
#include <cstddef>
#include <optional>

namespace lamina {
namespace {

// Metres or radians.
constexpr double kUnmoved = 1e-6;

}  // namespace

void PutSlidesBack(const std::vector<BatchFrame>& frames, const std::vector<BundleFault>& faults,
                   std::vector<SE3>* poses) {
  // From the last group: others, before it, may follow it.
  for (std::size_t end = faults.size(), begin = end; end > 0; end = begin) {
    const auto held = static_cast<std::size_t>(faults[end - 1].frame);
    while (begin > 0 && static_cast<std::size_t>(faults[begin - 1].frame) == held) --begin;
    std::vector<const BundleFault*> slides;
    Eigen::MatrixXd open(6, 0);
    for (std::size_t i = begin; i < end; ++i) {
      const std::vector<int>& group = faults[i].group;
      if (faults[i].motion.empty()) continue;
      const auto at = std::find(group.begin(), group.end(), faults[i].frame) - group.begin();
      slides.push_back(&faults[i]);
      open.conservativeResize(Eigen::NoChange, open.cols() + 1);
      open.rightCols<1>() = faults[i].motion[static_cast<std::size_t>(at)];
    }
    if (slides.empty()) continue;
    const Vector6d moved = LocalDelta(frames[held].T_world_lidar, (*poses)[held]);
    const Eigen::VectorXd along = open.colPivHouseholderQr().solve(moved);
    for (std::size_t i = 0; i < slides.size(); ++i) {
      for (std::size_t k = 0; k < slides[i]->group.size(); ++k) {
        SE3& T = (*poses)[static_cast<std::size_t>(slides[i]->group[k])];
        T = Retract(T, -along(static_cast<Eigen::Index>(i)) * slides[i]->motion[k]);
      }
    }
  }
}

void PutPartsBack(const std::vector<BatchFrame>& frames, const std::vector<BundleFault>& faults,
                  std::vector<SE3>* poses) {
  std::vector<std::vector<int>> parts;
  std::vector<bool> apart(frames.size(), false);
  for (const BundleFault& fault : faults) {
    if (fault.kind == BundleFault::Kind::kApart && !fault.group.empty()) {
      parts.push_back(fault.group);
    } else if (fault.kind == BundleFault::Kind::kTooFewPlanes && fault.shared_planes == 0) {
      parts.push_back({fault.frame});
    } else {
      continue;
    }
    for (const int frame : parts.back()) apart[static_cast<std::size_t>(frame)] = true;
  }
  for (const std::vector<int>& part : parts) {
    const auto first = static_cast<std::size_t>(*std::min_element(part.begin(), part.end()));
    const SE3& T_start = frames[first].T_world_lidar;
    if (((*poses)[first].t - T_start.t).norm() < kUnmoved &&
        RotationAngle((*poses)[first], T_start) < kUnmoved)
      continue;
    std::optional<std::size_t> beside;
    for (std::size_t k = first; k-- > 0 && !beside;) {
      if (!apart[k]) beside = k;
    }
    for (std::size_t k = first + 1; k < frames.size() && !beside; ++k) {
      if (!apart[k]) beside = k;
    }
    if (!beside) return;
    const SE3 T_beside_first = frames[*beside].T_world_lidar.Inverse() * T_start;
    const SE3 move = (*poses)[*beside] * T_beside_first * (*poses)[first].Inverse();
    for (const int frame : part) {
      SE3& T = (*poses)[static_cast<std::size_t>(frame)];
      T = move * T;
    }
  }
}

}  // namespace lamina
