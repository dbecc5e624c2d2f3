#include "backend/bundle/condensed_cost.h"

#include <algorithm>
#include <stdexcept>

#include "backend/bundle/frame_pass.h"

namespace lamina {
namespace {

void AddObservation(const FramePassItem& item, const PlaneFrame& f, const ObservationTerms& terms) {
  const double n = item.cluster.count;
  terms.AddGradient(item.plane.weight, n, f.normal.dot(terms.x), item.g);
  terms.AddSquare(item.plane.weight, n, item.D);
}

// `roots`: PlaneRoots of its plane.
void SetRows(double n, const PlaneFrame& f, const Eigen::Vector3d& roots,
             const ObservationTerms& terms, ReducedSystem::Rows* W) {
  W->row(0) = (roots(0) * n * f.u1.dot(terms.x)) * terms.j;
  W->row(0).head<3>() -= roots(0) * terms.turn1;
  W->row(1) = (roots(1) * n * f.u2.dot(terms.x)) * terms.j;
  W->row(1).head<3>() -= roots(1) * terms.turn2;
  W->row(2) = (-roots(2) * n) * terms.j;
}

}  // namespace

const std::vector<PlaneFrame>& CondensedCost::FramesAt(const std::vector<SE3>& poses,
                                                       const PoseMatrices& matrices) const {
  const auto same = [](const SE3& a, const SE3& b) {
    return a.q.coeffs() == b.q.coeffs() && a.t == b.t;
  };
  if (frames_.empty() || !std::equal(poses.begin(), poses.end(), at_.begin(), at_.end(), same)) {
    for_rows_.reset();
    frames_ = MakePlaneFrames(problem_, matrices);
    at_ = poses;
  }
  return frames_;
}

void CondensedCost::Linearise(const std::vector<SE3>& poses, ReducedSystem* system) {
  const PoseMatrices matrices(poses);
  const std::vector<PlaneFrame>& frames = FramesAt(poses, matrices);
  std::vector<Eigen::Vector3d> roots;
  roots.reserve(frames.size());
  for (std::size_t p = 0; p < frames.size(); ++p) {
    roots.push_back(PlaneRoots(frames[p], problem_.planes[p].weight, 0.0));
  }
  LineariseEigenvalueCost(
      problem_, index_, matrices, frames,
      [&](const FramePassItem& item, const PlaneFrame& frame) {
        const ObservationTerms terms(item, frame);
        AddObservation(item, frame, terms);
        SetRows(item.cluster.count, frame, roots[item.plane_index], terms, item.W);
      },
      system);
}

void CondensedCost::LineariseWithoutRows(const std::vector<SE3>& poses, ReducedSystem* system) {
  auto matrices = std::make_unique<PoseMatrices>(poses);
  const std::vector<PlaneFrame>& frames = FramesAt(poses, *matrices);
  system->cost = EigenvalueCost(problem_, frames);
  const auto add = [&](const FramePassItem& item) {
    const PlaneFrame& f = frames[item.plane_index];
    AddObservation(item, f, ObservationTerms(item, f));
  };
  PassOverFrames(problem_, index_, *matrices, false, add, system);
  for_rows_ = std::move(matrices);
}

void CondensedCost::MakeRows(std::size_t plane, ReducedSystem::Rows* rows) const {
  if (for_rows_ == nullptr) throw std::logic_error("rows are made after a linearisation alone");
  const Plane& of = problem_.planes[plane];
  const PlaneFrame& f = frames_[plane];
  const Eigen::Vector3d roots = PlaneRoots(f, of.weight, 0.0);
  for (int i = 0; i < of.count; ++i) {
    const auto o = static_cast<std::size_t>(of.first + i);
    const PlaneObservation& seen = problem_.observations[o];
    const auto k = static_cast<std::size_t>(seen.frame);
    const FramePassItem item{
        o,       plane,   seen.cluster, of,     for_rows_->R[k], for_rows_->t[k],
        nullptr, nullptr, nullptr,      nullptr};
    SetRows(seen.cluster.count, f, roots, ObservationTerms(item, f), rows + i);
  }
}

void CondensedCost::FindGradient(const std::vector<SE3>& poses, ReducedSystem* system) {
  const PoseMatrices matrices(poses);
  const std::vector<PlaneFrame>& frames = FramesAt(poses, matrices);
  system->cost = EigenvalueCost(problem_, frames);
  const auto add = [&](const FramePassItem& item) {
    const PlaneFrame& f = frames[item.plane_index];
    const Eigen::Vector3d m = item.R.transpose() * f.normal;
    const Eigen::Vector3d& mu = item.cluster.mean;
    const double distance = f.normal.dot(item.R * mu + item.t - f.mean);
    const double pull = item.plane.weight * item.cluster.count * distance;
    item.g->head<3>() += pull * mu.cross(m) - item.plane.weight * m.cross(item.cluster.scatter * m);
    item.g->tail<3>() += pull * f.normal;
  };
  PassOverFrames(problem_, index_, matrices, false, add, system);
}

double CondensedCost::Value(const std::vector<SE3>& poses) const {
  return EigenvalueCost(problem_, FramesAt(poses, PoseMatrices(poses)));
}

}  // namespace lamina
