#include "backend/bundle/plane_geometry.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/geometry/cluster_lanes.h"
#include "core/geometry/cluster_moments.h"

namespace lamina {

PoseMatrices::PoseMatrices(const std::vector<SE3>& poses) {
  R.reserve(poses.size());
  t.reserve(poses.size());
  for (const SE3& T : poses) {
    R.push_back(T.R());
    t.push_back(T.t);
  }
}

namespace {

// Adds the observations, moved, about an origin near the plane. Four lanes are summed apart and
// then together: the order depends on their number alone.
LAMINA_FOR_EACH_PROCESSOR
void SumMoved(const PlaneObservation* observations, std::size_t count, const PoseMatrices& poses,
              const Eigen::Vector3d& origin, ClusterMoments* sum) {
  constexpr int kFirst[6] = {0, 0, 0, 1, 1, 2}, kSecond[6] = {0, 1, 2, 1, 2, 2};
  Four n{}, first[3] = {}, second[6] = {};
  for (std::size_t i = 0; i < count; i += 4) {
    const std::size_t left = count - i;
    // Beyond the last observation it stands in, and weighs nothing.
    const PlaneObservation* const o = observations + i;
    const PlaneObservation* const four[4] = {o, left > 1 ? o + 1 : o, left > 2 ? o + 2 : o,
                                             left > 3 ? o + 3 : o};
    const Eigen::Matrix3d* R[4];
    const Eigen::Vector3d* t[4];
#pragma GCC unroll 4
    for (int k = 0; k < 4; ++k) {
      R[k] = &poses.R[static_cast<std::size_t>(four[k]->frame)];
      t[k] = &poses.t[static_cast<std::size_t>(four[k]->frame)];
    }
    ClusterLanes lanes;
    lanes.Load(NumbersOf(four[0]->cluster), NumbersOf(four[1]->cluster),
               NumbersOf(four[2]->cluster), NumbersOf(four[3]->cluster));
    MotionLanes motion;
    motion.Load(R, t);
    lanes.Move(motion);
    const Four taken{1.0, left > 1 ? 1.0 : 0.0, left > 2 ? 1.0 : 0.0, left > 3 ? 1.0 : 0.0};
    const Four weight = lanes.count * taken;
    Four d[3];
#pragma GCC unroll 3
    for (int a = 0; a < 3; ++a) d[a] = lanes.mean[a] - origin(a);
    n += weight;
#pragma GCC unroll 3
    for (int a = 0; a < 3; ++a) first[a] += weight * d[a];
#pragma GCC unroll 6
    for (int s = 0; s < 6; ++s) {
      second[s] += taken * lanes.scatter[s] + weight * d[kFirst[s]] * d[kSecond[s]];
    }
  }
  const auto together = [](const Four& f) { return (f[0] + f[1]) + (f[2] + f[3]); };
  sum->count += together(n);
  for (int a = 0; a < 3; ++a) sum->first(a) += together(first[a]);
  sum->second += {together(second[0]), together(second[1]), together(second[2]),
                  together(second[3]), together(second[4]), together(second[5])};
}

}  // namespace

PointCluster AggregatePlane(const BundleProblem& problem, const Plane& plane,
                            const PoseMatrices& poses) {
  if (plane.count == 0) return plane.fixed;
  const PlaneObservation* const first =
      problem.observations.data() + static_cast<std::size_t>(plane.first);
  const auto frame = static_cast<std::size_t>(first->frame);
  const Eigen::Vector3d origin =
      plane.fixed.Empty() ? Eigen::Vector3d(poses.R[frame] * first->cluster.mean + poses.t[frame])
                          : plane.fixed.mean;
  ClusterMoments sum = ClusterMoments::Of(plane.fixed, origin);
  SumMoved(first, static_cast<std::size_t>(plane.count), poses, origin, &sum);
  return sum.Cluster(origin);
}

PointCluster AggregatePlane(const BundleProblem& problem, const Plane& plane,
                            const std::vector<SE3>& poses) {
  return AggregatePlane(problem, plane, PoseMatrices(poses));
}

namespace {

// `eigen`: of its covariance.
PlaneFrame FrameOf(const PointCluster& aggregate, const Eigen3& eigen) {
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
  frame.u1 = eigen.u.col(0);
  frame.normal = eigen.u.col(2);
  frame.u2 = frame.normal.cross(frame.u1);
  // Not cwiseMax: it would turn NaN into zero.
  for (int i = 0; i < 3; ++i) frame.l(i) = eigen.l(i) < 0.0 ? 0.0 : eigen.l(i);
  return frame;
}

Symmetric3 CovarianceOf(const PointCluster& aggregate) {
  return aggregate.Empty() ? Symmetric3() : aggregate.Covariance();
}

}  // namespace

PlaneFrame MakePlaneFrame(const PointCluster& aggregate) {
  return FrameOf(aggregate, EigenDecompose(CovarianceOf(aggregate)));
}

std::vector<PlaneFrame> MakePlaneFrames(const BundleProblem& problem, const PoseMatrices& poses) {
  constexpr std::size_t kChunk = 64;  // planes
  std::vector<PlaneFrame> frames(problem.planes.size());
  ParallelChunks(frames.size(), kChunk, [&](std::size_t begin, std::size_t end) {
    PointCluster aggregates[kChunk];
    Symmetric3 covariances[kChunk];
    Eigen3 eigen[kChunk];
    for (std::size_t i = begin; i < end; ++i) {
      aggregates[i - begin] = AggregatePlane(problem, problem.planes[i], poses);
      covariances[i - begin] = CovarianceOf(aggregates[i - begin]);
    }
    EigenDecompose(covariances, end - begin, eigen);
    for (std::size_t i = begin; i < end; ++i) {
      frames[i] = FrameOf(aggregates[i - begin], eigen[i - begin]);
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
      bound += 0.5 * plane.weight * c.count * std::max(0.0, c.EigenPairs().l(2));
    }
  }
  return bound;
}

}  // namespace lamina
