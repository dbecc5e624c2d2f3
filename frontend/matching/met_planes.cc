// Which of the planes that a scan meets it sees through.
#include <algorithm>
#include <cstddef>
#include <vector>

#include "frontend/matching/map_residuals.h"

namespace lamina {

SeenThrough MapResiduals::FindSeenThrough(const MetPlanes& met, const Vector6d& direction,
                                          double feigned) const {
  // What is within rounding is decided by the sums.
  constexpr double kSure = 1.001;
  struct Facing {
    VoxelMap::NodeId id;
    const MetPlanes::Plane* plane;
    double information;  // along the direction
    bool through;
  };
  const Vector6d unscaled = DividedByArm(direction);
  std::vector<Facing> facing;
  std::vector<std::size_t> most_first;
  double all = feigned;
  for (const auto& [id, plane] : met.planes) {
    if (!plane.faces) continue;
    most_first.push_back(facing.size());
    facing.push_back({id, &plane, unscaled.dot(plane.sums.H() * unscaled), false});
    all += facing.back().information;
  }
  std::sort(most_first.begin(), most_first.end(), [&](std::size_t a, std::size_t b) {
    return facing[a].information > facing[b].information;
  });
  double opaque = 0.0;
  for (const std::size_t i : most_first) {
    Facing& f = facing[i];
    f.through = met.beams.SeeThrough(*f.plane->plane, map_.Aggregate(f.id), f.plane->points);
    if (!f.through) opaque += f.information;
    if (2.0 * opaque > kSure * all) return SeenThrough();
  }
  SeenThrough seen;
  for (const Facing& f : facing) {
    (f.through ? seen.H : seen.H_opaque) += f.plane->sums.H();
    if (f.through) seen.planes.push_back(f.id);
  }
  // Rounding differs across the diagonal.
  seen.H = seen.H.selfadjointView<Eigen::Upper>();
  seen.H_opaque = seen.H_opaque.selfadjointView<Eigen::Upper>();
  return seen;
}

bool MapResiduals::OfOneSensor(const MetPlanes& met) const {
  constexpr int kLeastOthers = 20;
  constexpr double kMostPassed = 0.02;
  const auto others = std::count_if(met.planes.begin(), met.planes.end(),
                                    [](const auto& p) { return !p.second.faces; });
  if (others < kLeastOthers) return false;
  int through = 0;
  for (const auto& [id, plane] : met.planes) {
    if (plane.faces || !met.beams.SeeThrough(*plane.plane, map_.Aggregate(id), plane.points))
      continue;
    if (++through > kMostPassed * static_cast<double>(others)) return false;
  }
  return true;
}

}  // namespace lamina
