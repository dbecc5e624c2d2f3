#include "backend/registration/frame_links.h"

#include <algorithm>
#include <cmath>

#include "backend/bundle/block_pattern.h"
#include "core/base/disjoint_sets.h"

namespace lamina {
namespace {

FrameLinks::Motion MotionOf(const SE3& a, const SE3& b, const SE3& a_after, const SE3& b_after) {
  const Eigen::Vector3d middle = 0.5 * (a.t + b.t);
  FrameLinks::Motion motion;
  motion.m = (a_after * (a.Inverse() * middle) - b_after * (b.Inverse() * middle)).norm();
  motion.rad = RotationAngle(a.Inverse() * b, a_after.Inverse() * b_after);
  return motion;
}

const SE3& At(const std::vector<SE3>& poses, int frame) {
  return poses[static_cast<std::size_t>(frame)];
}

// Number of the group of each observation of a plane: two are in one if a link that is not cut
// joins them, over others if need be.
std::vector<int> Groups(const BundleProblem& problem, const Plane& plane,
                        const std::set<int>& with_cuts, const FrameLinks& links) {
  std::vector<int> group(static_cast<std::size_t>(plane.count));
  std::size_t affected = 0;
  const auto frame = [&](std::size_t i) {
    return problem.observations[static_cast<std::size_t>(plane.first) + i].frame;
  };
  for (std::size_t i = 0; i < group.size(); ++i) affected += with_cuts.count(frame(i));
  if (affected < 2) return group;
  DisjointSets joined(group.size());
  for (std::size_t i = 0; i < group.size(); ++i) {
    for (std::size_t k = i + 1; k < group.size(); ++k) {
      if (joined.Find(i) != joined.Find(k) && !links.IsCut(frame(i), frame(k))) joined.Join(i, k);
    }
  }
  for (std::size_t i = 0; i < group.size(); ++i) group[i] = static_cast<int>(joined.Find(i));
  return group;
}

}  // namespace

void FrameLinks::Add(const BundleProblem& problem) {
  const BlockPattern pattern(problem, BundleIndex(problem));
  for (std::size_t f = 0; f < pattern.frames(); ++f) {
    for (const int k : pattern.partners(f)) {
      const int b = static_cast<int>(f);
      if (k != b) links_.try_emplace({k, b}, Begin{At(problem.poses, k), At(problem.poses, b)});
    }
  }
}

std::size_t FrameLinks::CutFarther(const std::vector<SE3>& poses, double max_m, double max_rad) {
  std::size_t cut = 0;
  for (const auto& [pair, begin] : links_) {
    const Motion motion =
        MotionOf(begin.T_world_a, begin.T_world_b, At(poses, pair.first), At(poses, pair.second));
    if (motion.m > max_m || motion.rad > max_rad) cut += cut_.insert(pair).second ? 1 : 0;
  }
  return cut;
}

bool FrameLinks::AnyFarther(const std::vector<SE3>& poses, double max_m, double max_rad) const {
  return std::any_of(links_.begin(), links_.end(), [&](const auto& link) {
    const auto& [pair, begin] = link;
    if (cut_.count(pair) > 0) return false;
    const Motion motion =
        MotionOf(begin.T_world_a, begin.T_world_b, At(poses, pair.first), At(poses, pair.second));
    return motion.m > max_m || motion.rad > max_rad;
  });
}

void FrameLinks::Apply(BundleProblem* problem) const {
  if (cut_.empty()) return;
  std::set<int> with_cuts;
  for (const auto& [a, b] : cut_) with_cuts.insert({a, b});
  std::vector<Plane> planes;
  std::vector<PlaneObservation> observations;
  std::vector<std::vector<WeightedPoint>> points;
  for (const Plane& plane : problem->planes) {
    const std::vector<int> group = Groups(*problem, plane, with_cuts, *this);
    for (int g = 0; g < plane.count; ++g) {
      const auto size = std::count(group.begin(), group.end(), g);
      const bool whole = size == plane.count;
      if (size == 0 || (size < 2 && !(whole && !plane.fixed.Empty()))) continue;
      Plane part = plane;
      part.first = static_cast<std::int32_t>(observations.size());
      part.count = static_cast<std::int32_t>(size);
      if (!whole) part.fixed = {};
      for (std::size_t i = 0; i < group.size(); ++i) {
        if (group[i] != g) continue;
        const std::size_t o = static_cast<std::size_t>(plane.first) + i;
        observations.push_back(problem->observations[o]);
        if (!problem->points.empty()) points.push_back(problem->points[o]);
      }
      planes.push_back(part);
    }
  }
  problem->planes = std::move(planes);
  problem->observations = std::move(observations);
  problem->points = std::move(points);
}

FrameLinks::Motion FrameLinks::Between(const std::vector<SE3>& before,
                                       const std::vector<SE3>& after) const {
  std::map<int, int> nearest;  // before each frame
  for (const auto& [pair, begin] : links_) {
    if (cut_.count(pair) == 0) nearest[pair.second] = std::max(nearest[pair.second], pair.first);
  }
  Motion sum;
  for (const auto& [b, a] : nearest) {
    const Motion motion = MotionOf(At(before, a), At(before, b), At(after, a), At(after, b));
    sum.m += motion.m * motion.m;
    sum.rad += motion.rad * motion.rad;
  }
  const double n = std::max<double>(1.0, static_cast<double>(nearest.size()));
  return {std::sqrt(sum.m / n), std::sqrt(sum.rad / n)};
}

}  // namespace lamina
