#include "backend/bundle/formulations/evm1_cost.h"

#include <stdexcept>

#include "backend/bundle/frame_pass.h"
#include "core/base/parallel.h"

namespace lamina {
namespace {

using PointList = std::vector<WeightedPoint>;

// The cluster of the points moved to the world.
PointCluster MovedPoints(const PointList& points, const Eigen::Matrix3d& R,
                         const Eigen::Vector3d& t) {
  PointCluster cluster;
  for (const WeightedPoint& point : points) {
    cluster.count += point.weight;
    cluster.mean += point.weight * (R * point.p + t);
  }
  cluster.mean /= cluster.count;
  for (const WeightedPoint& point : points) {
    cluster.scatter.AddOuter(point.weight, R * point.p + t - cluster.mean);
  }
  return cluster;
}

void AddPoints(const FramePassItem& item, const PointList& points, const PlaneFrame& f) {
  const Eigen::Vector3d m = item.R.transpose() * f.normal;
  const Eigen::Vector3d m1 = item.R.transpose() * f.u1, m2 = item.R.transpose() * f.u2;
  Matrix6d D = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero(), row1 = Vector6d::Zero(), row2 = Vector6d::Zero(),
           row3 = Vector6d::Zero();
  for (const WeightedPoint& point : points) {
    const Eigen::Vector3d& p = point.p;
    const Eigen::Vector3d x = item.R * p + item.t - f.mean;
    const double w = point.weight, r = w * f.normal.dot(x);
    const double a = w * f.u1.dot(x), b = w * f.u2.dot(x);
    Vector6d j;
    j << p.cross(m), f.normal;
    D.noalias() += w * j * j.transpose();
    g += r * j;
    row1 += a * j;
    row1.head<3>() += r * p.cross(m1);
    row1.tail<3>() += r * f.u1;
    row2 += b * j;
    row2.head<3>() += r * p.cross(m2);
    row2.tail<3>() += r * f.u2;
    row3 -= w * j;
  }
  const Eigen::Vector3d roots = PlaneRoots(f, item.plane.weight, f.l(2));
  *item.D += item.plane.weight * D;
  *item.g += item.plane.weight * g;
  item.W->row(0) = roots(0) * row1;
  item.W->row(1) = roots(1) * row2;
  item.W->row(2) = roots(2) * row3;
}

}  // namespace

Evm1Cost::Evm1Cost(const BundleProblem& problem) : problem_(problem), index_(problem) {
  bool complete = problem.points.size() == problem.observations.size();
  for (const PointList& points : problem.points) complete = complete && !points.empty();
  for (const Plane& plane : problem.planes) complete = complete && plane.fixed.Empty();
  if (!complete) {
    throw std::logic_error(
        "the point-wise formulation needs the points of every observation, and no fixed clusters");
  }
}

std::vector<PlaneFrame> Evm1Cost::Frames(const PoseMatrices& poses) const {
  constexpr std::size_t kChunk = 4;  // planes
  std::vector<PlaneFrame> frames(problem_.planes.size());
  ParallelChunks(frames.size(), kChunk, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      PointCluster sum;
      const auto first = static_cast<std::size_t>(problem_.planes[i].first);
      for (std::size_t o = first; o < first + static_cast<std::size_t>(problem_.planes[i].count);
           ++o) {
        const auto k = static_cast<std::size_t>(problem_.observations[o].frame);
        sum += MovedPoints(problem_.points[o], poses.R[k], poses.t[k]);
      }
      frames[i] = MakePlaneFrame(sum);
    }
  });
  return frames;
}

void Evm1Cost::Linearise(const std::vector<SE3>& poses, ReducedSystem* system) {
  const PoseMatrices matrices(poses);
  LineariseEigenvalueCost(
      problem_, index_, matrices, Frames(matrices),
      [&](const FramePassItem& item, const PlaneFrame& frame) {
        AddPoints(item, problem_.points[item.observation], frame);
      },
      system);
}

double Evm1Cost::Value(const std::vector<SE3>& poses) const {
  return EigenvalueCost(problem_, Frames(PoseMatrices(poses)));
}

const Formulation& Evm1Formulation() {
  static constexpr Formulation kFormulation = {"evm1",
                                               "BALM",
                                               "Liu and Zhang 2021",
                                               /*needs_points=*/true,
                                               /*takes_priors=*/true,
                                               /*converges_slowly=*/false,
                                               MakeCost<Evm1Cost>};
  return kFormulation;
}

}  // namespace lamina
