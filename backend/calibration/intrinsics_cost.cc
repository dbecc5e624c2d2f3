#include "backend/calibration/intrinsics_cost.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "backend/bundle/condensed_cost.h"
#include "backend/bundle/frame_pass.h"
#include "backend/bundle/index.h"
#include "backend/bundle/solver/held_directions.h"
#include "core/base/angle.h"

namespace lamina {
namespace {

using PlaneColumns = Eigen::Matrix<double, 3, 2>;
using PoseColumns = Eigen::Matrix<double, 6, 2>;

// Sums over the points of one observation, without the plane's weight.
struct ObservationSums {
  ObservationSums(const FramePassItem& item, const PlaneFrame& f) : terms(item, f) {
    const Eigen::Vector3d& mu = item.cluster.mean;
    const double n = item.cluster.count;
    c0 = IntrinsicsFieldAt(mu).transpose() * terms.m;
    const IntrinsicsFieldJacobians F = IntrinsicsFieldJacobiansAt(mu);
    g << F.elevation.transpose() * terms.m, F.range.transpose() * terms.m;
    for (int i = 0; i < 2; ++i) Sg.col(i) = item.cluster.scatter * Eigen::Vector3d(g.col(i));
    distance = f.normal.dot(terms.x);
    cr = n * distance * c0 + Sg.transpose() * terms.m;
  }
  ObservationTerms terms;
  Eigen::Vector2d c0, cr;
  IntrinsicsField g, Sg;
  double distance = 0.0;  // of the mean to the plane
};

// What the observations add to the rows and columns of the two unknowns.
struct Columns {
  std::vector<PoseColumns> poses;          // J'c of each frame
  std::vector<PlaneColumns> planes;        // (P'P)^-1/2 P'c of each observation
  std::vector<Eigen::Matrix2d> squares;    // c'c of each frame
  std::vector<Eigen::Vector2d> gradients;  // c'r of each frame
};

// Before any elimination.
Columns MakeColumns(const BundleProblem& problem, const BundleIndex& index,
                    const PoseMatrices& matrices, const std::vector<PlaneFrame>& frames) {
  Columns columns;
  columns.poses.assign(index.frames(), PoseColumns::Zero());
  columns.planes.resize(problem.observations.size());
  columns.squares.assign(index.frames(), Eigen::Matrix2d::Zero());
  columns.gradients.assign(index.frames(), Eigen::Vector2d::Zero());
  const auto add = [&](const FramePassItem& item) {
    const auto k = static_cast<std::size_t>(problem.observations[item.observation].frame);
    const PlaneFrame& f = frames[item.plane_index];
    const ObservationSums s(item, f);
    const double w = item.plane.weight, n = item.cluster.count;
    columns.squares[k] += w * (n * s.c0 * s.c0.transpose() + s.g.transpose() * s.Sg);
    columns.gradients[k] += w * s.cr;
    columns.poses[k] += (w * n) * s.terms.j * s.c0.transpose();
    for (int i = 0; i < 2; ++i) {
      columns.poses[k].col(i).head<3>() -= w * s.terms.m.cross(Eigen::Vector3d(s.Sg.col(i)));
    }
    const Eigen::Vector3d roots = PlaneRoots(f, w, 0.0);
    PlaneColumns& W = columns.planes[item.observation];
    W.row(0) = roots(0) * (n * f.u1.dot(s.terms.x) * s.c0 + s.Sg.transpose() * s.terms.m1);
    W.row(1) = roots(1) * (n * f.u2.dot(s.terms.x) * s.c0 + s.Sg.transpose() * s.terms.m2);
    W.row(2) = -roots(2) * n * s.c0;
  };
  ReducedSystem unused;
  PassOverFrames(problem, index, matrices, false, add, &unused);
  return columns;
}

// (P'P)^-1/2 P'(c + J slope), summed over the observations of a plane: how it answers the unknowns,
// but for the sign.
PlaneColumns PlaneAnswer(const BundleProblem& problem, const Plane& plane,
                         const ReducedSystem& reduced, const Columns& columns,
                         const IntrinsicsSystem& system) {
  PlaneColumns sum = PlaneColumns::Zero();
  for (int i = plane.first; i < plane.first + plane.count; ++i) {
    const auto o = static_cast<std::size_t>(i);
    const auto row = 6 * static_cast<Eigen::Index>(problem.observations[o].frame);
    sum += columns.planes[o] + reduced.rows[o] * system.pose_slope.middleRows<6>(row);
  }
  return sum;
}

int ElevationOf(const Eigen::Vector3d& p) {
  const double degrees = Degrees(std::atan2(p.z(), p.head<2>().norm()));
  return static_cast<int>(std::lround(degrees)) +
         static_cast<int>(GradientByElevation::ColsAtCompileTime) / 2;
}

void GatherByElevation(const BundleProblem& problem, const PoseMatrices& matrices,
                       const std::vector<PlaneFrame>& frames, const ReducedSystem& reduced,
                       const Columns& columns, IntrinsicsSystem* system) {
  for (std::size_t p = 0; p < problem.planes.size(); ++p) {
    const Plane& plane = problem.planes[p];
    const PlaneFrame& f = frames[p];
    const PlaneColumns answer = PlaneAnswer(problem, plane, reduced, columns, *system);
    const Eigen::Vector3d roots = PlaneRoots(f, plane.weight, 0.0);
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const PlaneObservation& o = problem.observations[static_cast<std::size_t>(i)];
      const auto k = static_cast<std::size_t>(o.frame);
      const ObservationSums s(
          FramePassItem{static_cast<std::size_t>(i), p, o.cluster, plane, matrices.R[k],
                        matrices.t[k], nullptr, nullptr, nullptr, nullptr},
          f);
      Vector6d Jr = Vector6d::Zero();
      s.terms.AddGradient(plane.weight, o.cluster.count, s.distance, &Jr);
      const Eigen::Vector3d Sm = o.cluster.scatter * s.terms.m;
      const double n = o.cluster.count;
      const Eigen::Vector3d Pr(
          roots(0) * (n * f.u1.dot(s.terms.x) * s.distance + s.terms.m1.dot(Sm)),
          roots(1) * (n * f.u2.dot(s.terms.x) * s.distance + s.terms.m2.dot(Sm)),
          -roots(2) * n * s.distance);
      system->g_by_elevation.col(ElevationOf(o.cluster.mean)) +=
          plane.weight * s.cr +
          system->pose_slope.middleRows<6>(static_cast<Eigen::Index>(6 * k)).transpose() * Jr -
          answer.transpose() * Pr;
    }
  }
}

}  // namespace

IntrinsicsSystem LineariseIntrinsics(const BundleProblem& problem, const std::vector<SE3>& poses) {
  const BundleIndex index(problem);
  const PoseMatrices matrices(poses);
  ReducedSystem reduced;
  CondensedCost(problem).Linearise(poses, &reduced);
  const std::vector<PlaneFrame> frames = MakePlaneFrames(problem, matrices);
  const Columns columns = MakeColumns(problem, index, matrices, frames);
  IntrinsicsSystem system;
  system.cost = reduced.cost;
  Eigen::Matrix<double, Eigen::Dynamic, 2> Hpc(reduced.gradient.size(), 2);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    system.H += columns.squares[k];
    system.g += columns.gradients[k];
    Hpc.middleRows<6>(static_cast<Eigen::Index>(6 * k)) = columns.poses[k];
  }
  for (const Plane& plane : problem.planes) {
    PlaneColumns sum = PlaneColumns::Zero();
    const auto first = static_cast<std::size_t>(plane.first);
    const auto end = first + static_cast<std::size_t>(plane.count);
    for (std::size_t o = first; o < end; ++o) sum += columns.planes[o];
    system.H -= sum.transpose() * sum;
    for (std::size_t o = first; o < end; ++o) {
      Hpc.middleRows<6>(6 * static_cast<Eigen::Index>(problem.observations[o].frame)) -=
          reduced.rows[o].transpose() * sum;
    }
  }
  Eigen::MatrixXd Hpp;
  reduced.Assemble(problem, index, &Hpp);
  const HeldDirections held(problem);
  held.TakeOut(&Hpp);
  held.Project(&reduced.gradient);
  held.Project(&Hpc);
  // So that a frame without planes can be factorised.
  Hpp.diagonal().array() += 1e-14 * Hpp.diagonal().maxCoeff() + 1e-300;
  const Eigen::LLT<Eigen::MatrixXd> llt(Hpp);
  system.pose_step = -llt.solve(reduced.gradient);
  system.pose_slope = -llt.solve(Hpc);
  system.H += Hpc.transpose() * system.pose_slope;
  system.g += Hpc.transpose() * system.pose_step;
  GatherByElevation(problem, matrices, frames, reduced, columns, &system);
  return system;
}

}  // namespace lamina
