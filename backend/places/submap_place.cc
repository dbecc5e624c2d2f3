#include "backend/places/submap_place.h"

#include <algorithm>
#include <utility>

namespace lamina {

PlaceImage ImageOfSubmap(const Submap& submap, const std::vector<LeafPlane>& planes,
                         const Submap* before, const PlaceImage* image_before,
                         const PlaceOptions& options) {
  constexpr double kChangeDeg = 12.0;
  Eigen::Vector3d up = submap.T_world_submap.q.conjugate() * Eigen::Vector3d::UnitZ();
  PlaceOptions tilted = options;
  if (before != nullptr) {
    const SE3 T_this_last = submap.T_world_submap.Inverse() * before->T_world_submap;
    up = T_this_last.q * (image_before->T_level_submap.q.conjugate() * Eigen::Vector3d::UnitZ());
    tilted.max_tilt_deg = std::min(options.max_tilt_deg, kChangeDeg);
  }
  return MakePlaceImage(submap, planes, tilted, up);
}

SubmapQuery QueryOfSubmap(const Submap& submap, std::vector<LeafPlane> planes,
                          const PlaceImage& image) {
  return MakeQuery(submap, std::move(planes),
                   image.T_level_submap.q.conjugate() * Eigen::Vector3d::UnitZ());
}

}  // namespace lamina
