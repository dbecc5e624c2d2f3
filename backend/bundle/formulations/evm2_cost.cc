#include "backend/bundle/formulations/evm2_cost.h"

#include "backend/bundle/frame_pass.h"

namespace lamina {
namespace {

void AddSecondOrder(const FramePassItem& item, const PlaneFrame& f) {
  const ObservationTerms terms(item, f);
  const double n = item.cluster.count, w = item.plane.weight;
  const double distance = f.normal.dot(terms.x);
  terms.AddGradient(w, n, distance, item.g);
  terms.AddSquare(w, n, item.D);
  const Eigen::Vector3d q = (n * distance) * item.cluster.mean + item.cluster.scatter * terms.m;
  Eigen::Matrix3d curvature = 0.5 * (terms.m * q.transpose() + q * terms.m.transpose());
  curvature.diagonal().array() -= terms.m.dot(q);
  item.D->topLeftCorner<3, 3>() += w * curvature;

  const Eigen::Vector3d roots = PlaneRoots(f, w, f.l(2));
  Vector6d row = (n * f.u1.dot(terms.x)) * terms.j;
  row.head<3>() += q.cross(terms.m1) - terms.turn1;
  row.tail<3>() += (n * distance) * f.u1;
  item.W->row(0) = roots(0) * row;
  row = (n * f.u2.dot(terms.x)) * terms.j;
  row.head<3>() += q.cross(terms.m2) - terms.turn2;
  row.tail<3>() += (n * distance) * f.u2;
  item.W->row(1) = roots(1) * row;
  item.W->row(2) = (-roots(2) * n) * terms.j;
}

}  // namespace

void Evm2Cost::Linearise(const std::vector<SE3>& poses, ReducedSystem* system) {
  const PoseMatrices matrices(poses);
  LineariseEigenvalueCost(
      problem_, index_, matrices, MakePlaneFrames(problem_, matrices),
      [](const FramePassItem& item, const PlaneFrame& frame) { AddSecondOrder(item, frame); },
      system);
}

double Evm2Cost::Value(const std::vector<SE3>& poses) const {
  return EigenvalueCost(problem_, poses);
}

const Formulation& Evm2Formulation() {
  static constexpr Formulation kFormulation = {"evm2",
                                               "BALM 2",
                                               "Liu et al. 2022",
                                               /*needs_points=*/false,
                                               /*takes_priors=*/true,
                                               /*converges_slowly=*/false,
                                               MakeCost<Evm2Cost>};
  return kFormulation;
}

}  // namespace lamina
