#include "backend/bundle/condensed_cost.h"

#include "backend/bundle/frame_pass.h"

namespace lamina {
namespace {

void SetRows(const Plane& plane, double count, const PlaneFrame& f, const ObservationTerms& terms,
             ReducedSystem::Rows* W) {
  const Eigen::Vector3d roots = PlaneRoots(f, plane.weight, 0.0);
  W->row(0) = (roots(0) * count * f.u1.dot(terms.x)) * terms.j;
  W->row(0).head<3>() -= roots(0) * terms.turn1;
  W->row(1) = (roots(1) * count * f.u2.dot(terms.x)) * terms.j;
  W->row(1).head<3>() -= roots(1) * terms.turn2;
  W->row(2) = (-roots(2) * count) * terms.j;
}

void AddObservation(const FramePassItem& item, const PlaneFrame& f) {
  const ObservationTerms terms(item, f);
  const double n = item.cluster.count;
  terms.AddGradient(item.plane.weight, n, f.normal.dot(terms.x), item.g);
  terms.AddSquare(item.plane.weight, n, item.D);
  if (item.W != nullptr) SetRows(item.plane, n, f, terms, item.W);
}

}  // namespace

void CondensedCost::Linearise(const std::vector<SE3>& poses, ReducedSystem* system) {
  const PoseMatrices matrices(poses);
  LineariseEigenvalueCost(
      problem_, index_, matrices, MakePlaneFrames(problem_, matrices),
      [](const FramePassItem& item, const PlaneFrame& frame) { AddObservation(item, frame); },
      system);
}

void CondensedCost::LineariseWithoutRows(const std::vector<SE3>& poses, ReducedSystem* system) {
  poses_ = std::make_unique<PoseMatrices>(poses);
  frames_ = MakePlaneFrames(problem_, *poses_);
  system->cost = EigenvalueCost(problem_, frames_);
  PassOverFrames(
      problem_, index_, *poses_, /*with_rows=*/false,
      [&](const FramePassItem& item) { AddObservation(item, frames_[item.plane_index]); }, system);
}

void CondensedCost::MakeRows(std::size_t plane, ReducedSystem::Rows* rows) const {
  const Plane& of = problem_.planes[plane];
  for (int i = 0; i < of.count; ++i) {
    const auto o = static_cast<std::size_t>(of.first + i);
    const PlaneObservation& seen = problem_.observations[o];
    const auto k = static_cast<std::size_t>(seen.frame);
    const FramePassItem item{o,       plane,   seen.cluster, of,     poses_->R[k], poses_->t[k],
                             nullptr, nullptr, nullptr,      nullptr};
    SetRows(of, seen.cluster.count, frames_[plane], ObservationTerms(item, frames_[plane]),
            rows + i);
  }
}

double CondensedCost::Value(const std::vector<SE3>& poses) const {
  return EigenvalueCost(problem_, poses);
}

}  // namespace lamina
