#include "backend/loops/loop_agreement.h"

#include <algorithm>

#include "backend/loops/loop_closure.h"
#include "core/base/angle.h"

namespace lamina {

PoseDifference DifferenceAt(const Eigen::Vector3d& p, const SE3& a, const SE3& b) {
  return {(a * p - b * p).norm(), RotationAngle(a, b)};
}

PoseDifference WithDrift(const PoseDifference& slack, const LoopOptions& options, double way_m) {
  return {slack.m + 0.01 * options.max_drift_percent * way_m,
          slack.rad + Radians(0.01 * options.max_drift_deg_per_100m * way_m)};
}

PoseDifference AgreementBound(const LoopOptions& options, double way_m) {
  return WithDrift({0.5, Radians(1.5)}, options, way_m);
}

Loop LoopOf(const SubmapPair& pair, const SubmapMatch& match, const VerificationOptions& options) {
  Loop loop;
  loop.from = pair.from;
  loop.to = pair.to;
  loop.score = pair.score;
  loop.match = match;
  loop.reason = Refusal(match, options);
  loop.status = loop.reason.empty() ? Loop::Status::kWaiting : Loop::Status::kRefused;
  return loop;
}

bool IsWhereExpected(const Loop& loop, const SubmapPair& pair, const PlaceImage& query) {
  constexpr double kMostM = 2.0, kMostDeg = 3.0;
  return DifferenceAt(query.middle(), pair.T_from_to, loop.match.T_other_query)
      .Within({kMostM, Radians(kMostDeg)});
}

void KeepNearest(std::size_t most, std::vector<std::pair<double, std::size_t>>* near) {
  std::sort(near->begin(), near->end());
  if (near->size() > most) near->resize(most);
}

bool LoopClosure::Agree(const Loop& a, const Loop& b) const {
  // What one submap finds is found by its errors, too.
  if (a.to == b.to) return false;
  const double way = std::abs(places_[a.from].way_m - places_[b.from].way_m) +
                     std::abs(places_[a.to].way_m - places_[b.to].way_m);
  const auto between = [&](std::size_t i, std::size_t j) {
    return submaps_[i].T_world_submap.Inverse() * submaps_[j].T_world_submap;
  };
  const SE3 around = between(a.from, b.from) * b.match.T_other_query * between(b.to, a.to);
  return AgreesAfter(way, around, a);
}

bool LoopClosure::AgreesAfter(double way_m, const SE3& T_from_to, const Loop& loop) const {
  // After so much drift agreement is no evidence.
  const PoseDifference most = AgreementBound(options_, way_m);
  return most.m <= kMostAgreeM &&
         DifferenceAt(places_[loop.to].image.middle(), T_from_to, loop.match.T_other_query)
             .Within(most);
}

// With what edges and loops accepted before say. The way along them leads through other submaps'
// loops: at the time it was found this one's had none.
bool LoopClosure::AgreesWithGraph(const Loop& loop) const {
  return corrected_ &&
         AgreesAfter(loop.way_m, anchors_[loop.from].Inverse() * anchors_[loop.to], loop);
}

bool LoopClosure::AcceptAgreeing() {
  std::vector<bool> agrees(loops_.size(), false);
  for (std::size_t i = 0; i < loops_.size(); ++i) {
    if (loops_[i].status != Loop::Status::kWaiting) continue;
    agrees[i] = loops_[i].to + 1 == submaps_.size() && AgreesWithGraph(loops_[i]);
    for (std::size_t j = 0; j < loops_.size() && !agrees[i]; ++j) {
      if (loops_[j].status == Loop::Status::kRefused) continue;
      agrees[i] = Agree(loops_[std::max(i, j)], loops_[std::min(i, j)]);
    }
  }
  bool any = false;
  for (std::size_t i = 0; i < loops_.size(); ++i) {
    if (loops_[i].status != Loop::Status::kWaiting) continue;
    loops_[i].reason = agrees[i] ? "" : "no other loop agrees";
    if (!agrees[i]) continue;
    loops_[i].status = Loop::Status::kAccepted;
    any = true;
  }
  return any;
}

}  // namespace lamina
