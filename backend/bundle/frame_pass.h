// The passes over all observations that the formulations share.
#pragma once

#include <cstddef>
#include <numeric>
#include <vector>

#include "backend/bundle/cost.h"
#include "backend/bundle/plane_geometry.h"
#include "core/base/parallel.h"

namespace lamina {

// One observation: what a formulation sees of it, and where its share goes.
struct FramePassItem {
  std::size_t observation, plane_index;
  const PointCluster& cluster;  // LiDAR frame
  const Plane& plane;
  const Eigen::Matrix3d& R;  // T_world_lidar
  const Eigen::Vector3d& t;
  Matrix6d* D;
  Vector6d* g;
  ReducedSystem::Rows* W;  // null unless the formulation has rows
  double* cost;
};

// Calls add(item) for every observation, frames in parallel. `add` sums into D, g and, where the
// cost is one of observations, cost; and sets W. Returns the sum of these costs.
template <typename Add>
double PassOverFrames(const BundleProblem& problem, const BundleIndex& index,
                      const PoseMatrices& poses, bool with_rows, const Add& add,
                      ReducedSystem* system) {
  const std::size_t size = index.frames();
  system->gradient.resize(static_cast<Eigen::Index>(6 * size));
  system->diagonal.resize(size);
  system->rows.resize(with_rows ? problem.observations.size() : 0);
  std::vector<double> costs(size);
  constexpr std::size_t kChunk = 4;  // frames
  ParallelChunks(size, kChunk, [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = begin; f < end; ++f) {
      Matrix6d D = Matrix6d::Zero();
      Vector6d g = Vector6d::Zero();
      double cost = 0.0;
      for (auto* e = index.begin(f); e != index.end(f); ++e) {
        const auto o = static_cast<std::size_t>(e->observation);
        const auto p = static_cast<std::size_t>(e->plane);
        add(FramePassItem{o, p, problem.observations[o].cluster, problem.planes[p], poses.R[f],
                          poses.t[f], &D, &g, with_rows ? &system->rows[o] : nullptr, &cost});
      }
      system->diagonal[f] = D;
      costs[f] = cost;
      system->gradient.segment<6>(static_cast<Eigen::Index>(6 * f)) = g;
    }
  });
  return std::accumulate(costs.begin(), costs.end(), 0.0);
}

// The same for a formulation whose cost is EigenvalueCost, frames those of the planes at the poses:
// calls add(item, frame of its plane).
template <typename Add>
void LineariseEigenvalueCost(const BundleProblem& problem, const BundleIndex& index,
                             const PoseMatrices& poses, const std::vector<PlaneFrame>& frames,
                             const Add& add, ReducedSystem* system) {
  system->cost = EigenvalueCost(problem, frames);
  PassOverFrames(
      problem, index, poses, true,
      [&](const FramePassItem& item) { add(item, frames[item.plane_index]); }, system);
}

// sum_planes 1/2 weight sum_k square(plane, observation, R_k, t_k), planes in parallel.
template <typename Square>
double SumOfSquares(const BundleProblem& problem, const PoseMatrices& poses, const Square& square) {
  constexpr std::size_t kChunk = 64;  // planes
  return ParallelSum(problem.planes.size(), kChunk, 0.0, [&](std::size_t begin, std::size_t end) {
    double sum = 0.0;
    for (std::size_t p = begin; p < end; ++p) {
      const Plane& plane = problem.planes[p];
      for (int i = plane.first; i < plane.first + plane.count; ++i) {
        const auto o = static_cast<std::size_t>(i);
        const auto k = static_cast<std::size_t>(problem.observations[o].frame);
        sum += 0.5 * plane.weight * square(p, o, poses.R[k], poses.t[k]);
      }
    }
    return sum;
  });
}

// An observation in the frame of its plane: the terms of which all the formulations' derivatives
// are made. Right-handed m1, m2, m = R'(u1, u2, normal); S the cluster's scatter, s_ij = m_i' S
// m_j.
struct ObservationTerms {
  ObservationTerms(const FramePassItem& item, const PlaneFrame& f)
      : m(item.R.transpose() * f.normal),
        m1(item.R.transpose() * f.u1),
        m2(item.R.transpose() * f.u2),
        x(item.R * item.cluster.mean + item.t - f.mean) {
    const Eigen::Vector3d Sm1 = item.cluster.scatter * m1, Sm2 = item.cluster.scatter * m2;
    const double s11 = m1.dot(Sm1), s12 = m2.dot(Sm1), s22 = m2.dot(Sm2);
    const double s10 = m.dot(Sm1), s20 = m.dot(Sm2);
    turn0 = s10 * m2 - s20 * m1;
    turn1 = s11 * m2 - s12 * m1;
    turn2 = s12 * m2 - s22 * m1;
    j << item.cluster.mean.cross(m), f.normal;
  }
  Eigen::Vector3d m, m1, m2;
  Eigen::Vector3d x;                    // R mu_k + t - mu
  Eigen::Vector3d turn0, turn1, turn2;  // m x S m, m x S m1, m x S m2
  Vector6d j;                           // [mu_k x m; normal]: the residual of mu_k by the pose

  // Adds w J'J: n j j' + [m]x S [m]x' in the rotations.
  void AddSquare(double w, double count, Matrix6d* D) const {
    D->noalias() += (w * count) * j * j.transpose();
    D->topLeftCorner<3, 3>().noalias() += w * (turn1 * m2.transpose() - turn2 * m1.transpose());
  }
  // Adds w J'r: n j (normal . x) - [m x S m; 0].
  void AddGradient(double w, double count, double distance, Vector6d* g) const {
    *g += (w * count * distance) * j;
    g->head<3>() -= w * turn0;
  }
};

}  // namespace lamina
