#include "backend/bundle/index.h"

#include <sstream>
#include <stdexcept>

namespace lamina {
namespace {

void CheckPlane(const BundleProblem& problem, const Plane& plane) {
  for (int i = plane.first; i < plane.first + plane.count; ++i) {
    const int frame = problem.observations.at(static_cast<std::size_t>(i)).frame;
    const bool sorted =
        i == plane.first || problem.observations[static_cast<std::size_t>(i - 1)].frame < frame;
    if (frame >= 0 && static_cast<std::size_t>(frame) < problem.poses.size() && sorted) continue;
    std::ostringstream message;
    message << "observation " << i << " names frame " << frame << " of " << problem.poses.size()
            << "; frames of a plane must exist and ascend";
    throw std::logic_error(message.str());
  }
}

}  // namespace

BundleIndex::BundleIndex(const BundleProblem& problem) : first_(problem.poses.size() + 1, 0) {
  observed_by_.reserve(problem.observations.size());
  for (const PlaneObservation& o : problem.observations) observed_by_.push_back(o.frame);
  for (const Plane& plane : problem.planes) {
    CheckPlane(problem, plane);
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      ++first_[static_cast<std::size_t>(problem.observations[static_cast<std::size_t>(i)].frame) +
               1];
    }
  }
  for (std::size_t k = 1; k < first_.size(); ++k) first_[k] += first_[k - 1];
  entries_.resize(first_.back());
  std::vector<std::size_t> next(first_.begin(), first_.end() - 1);
  for (std::size_t p = 0; p < problem.planes.size(); ++p) {
    const Plane& plane = problem.planes[p];
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const int frame = problem.observations[static_cast<std::size_t>(i)].frame;
      entries_[next[static_cast<std::size_t>(frame)]++] = {i, static_cast<std::int32_t>(p)};
    }
  }
}

}  // namespace lamina
