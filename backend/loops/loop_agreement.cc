#include "backend/loops/loop_agreement.h"

#include <algorithm>

#include "core/base/angle.h"

namespace lamina {

PoseDifference DifferenceAt(const Eigen::Vector3d& p, const SE3& a, const SE3& b) {
  return {(a * p - b * p).norm(), RotationAngle(a, b)};
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
      .Within(kMostM, Radians(kMostDeg));
}

void KeepNearest(std::size_t most, std::vector<std::pair<double, std::size_t>>* near) {
  std::sort(near->begin(), near->end());
  if (near->size() > most) near->resize(most);
}

}  // namespace lamina
