#include "backend/bundle/condensed_cost.h"

#include "backend/bundle/frame_pass.h"

namespace lamina {
namespace {

void AddObservation(const FramePassItem& item, const PlaneFrame& f) {
  const ObservationTerms terms(item, f);
  const double n = item.cluster.count;
  terms.AddGradient(item.plane.weight, n, f.normal.dot(terms.x), item.g);
  terms.AddSquare(item.plane.weight, n, item.D);
  const Eigen::Vector3d roots = PlaneRoots(f, item.plane.weight, 0.0);
  item.W->row(0) = (roots(0) * n * f.u1.dot(terms.x)) * terms.j;
  item.W->row(0).head<3>() -= roots(0) * terms.turn1;
  item.W->row(1) = (roots(1) * n * f.u2.dot(terms.x)) * terms.j;
  item.W->row(1).head<3>() -= roots(1) * terms.turn2;
  item.W->row(2) = (-roots(2) * n) * terms.j;
}

}  // namespace

void CondensedCost::Linearise(const std::vector<SE3>& poses, ReducedSystem* system) {
  const PoseMatrices matrices(poses);
  LineariseEigenvalueCost(
      problem_, index_, matrices, MakePlaneFrames(problem_, matrices),
      [](const FramePassItem& item, const PlaneFrame& frame) { AddObservation(item, frame); },
      system);
}

double CondensedCost::Value(const std::vector<SE3>& poses) const {
  return EigenvalueCost(problem_, poses);
}

}  // namespace lamina
