#include "backend/bundle/plane_geometry.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"

namespace lamina {

PoseMatrices::PoseMatrices(const std::vector<SE3>& poses) {
  R.reserve(poses.size());
  t.reserve(poses.size());
  for (const SE3& T : poses) {
    R.push_back(T.R());
    t.push_back(T.t);
  }
}

PointCluster AggregatePlane(const BundleProblem& problem, const Plane& plane,
                            const PoseMatrices& poses) {
  PointCluster sum = plane.fixed;
  for (int i = plane.first; i < plane.first + plane.count; ++i) {
    const PlaneObservation& o = problem.observations[static_cast<std::size_t>(i)];
    const auto k = static_cast<std::size_t>(o.frame);
    sum += o.cluster.Moved(poses.R[k], poses.t[k]);
  }
  return sum;
}

PointCluster AggregatePlane(const BundleProblem& problem, const Plane& plane,
                            const std::vector<SE3>& poses) {
  return AggregatePlane(problem, plane, PoseMatrices(poses));
}

PlaneFrame MakePlaneFrame(const PointCluster& aggregate) {
  PlaneFrame frame;
  frame.count = aggregate.count;
  frame.mean = aggregate.mean;
  if (aggregate.Empty()) {
    frame.u1 = Eigen::Vector3d::UnitX();
    frame.u2 = Eigen::Vector3d::UnitY();
    frame.normal = Eigen::Vector3d::UnitZ();
    frame.l.setZero();
    return frame;
  }
  const Eigen3 eigen = aggregate.Eigen();
  frame.u1 = eigen.u.col(0);
  frame.normal = eigen.u.col(2);
  frame.u2 = frame.normal.cross(frame.u1);
  // Not cwiseMax: it would turn NaN into zero.
  for (int i = 0; i < 3; ++i) frame.l(i) = eigen.l(i) < 0.0 ? 0.0 : eigen.l(i);
  return frame;
}

std::vector<PlaneFrame> MakePlaneFrames(const BundleProblem& problem, const PoseMatrices& poses) {
  constexpr std::size_t kChunk = 64;  // planes
  std::vector<PlaneFrame> frames(problem.planes.size());
  ParallelChunks(frames.size(), kChunk, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      frames[i] = MakePlaneFrame(AggregatePlane(problem, problem.planes[i], poses));
    }
  });
  return frames;
}

Eigen::Vector3d PlaneRoots(const PlaneFrame& frame, double weight, double subtract) {
  constexpr double kNoExtent = 1e-12;  // m^2
  const auto inverse = [&](double l) {
    return l > kNoExtent ? std::sqrt(weight / (frame.count * l)) : 0.0;
  };
  return {inverse(frame.l(0) - subtract), inverse(frame.l(1) - subtract),
          std::sqrt(weight / frame.count)};
}

double EigenvalueCost(const BundleProblem& problem, const std::vector<SE3>& poses) {
  return EigenvalueCost(problem, MakePlaneFrames(problem, PoseMatrices(poses)));
}

double EigenvalueCost(const BundleProblem& problem, const std::vector<PlaneFrame>& frames) {
  double cost = 0.0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    cost += 0.5 * problem.planes[i].weight * frames[i].count * frames[i].l(2);
  }
  return cost;
}

double EigenvalueLowerBound(const BundleProblem& problem) {
  double bound = 0.0;
  for (const Plane& plane : problem.planes) {
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const PointCluster& c = problem.observations[static_cast<std::size_t>(i)].cluster;
      bound += 0.5 * plane.weight * c.count * std::max(0.0, c.Eigen().l(2));
    }
  }
  return bound;
}

}  // namespace lamina
