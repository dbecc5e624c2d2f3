#include "backend/localisation/place_evidence.h"

#include <algorithm>
#include <cstddef>

namespace lamina {
namespace {

// Points that are asked for.
constexpr std::size_t kMostPoints = 4000;

}  // namespace

OccupiedLeaves::OccupiedLeaves(const Submap& place)
    : leaf_size_m_(place.leaf_size_m), index_(place.leaves.size()) {
  for (const SubmapLeaf& leaf : place.leaves)
    index_.Insert(PackVoxelKey(leaf.index[0], leaf.index[1], leaf.index[2]));
}

double OccupiedLeaves::Met(const std::vector<Eigen::Vector3f>& points,
                           const SE3& T_place_query) const {
  const std::size_t stride = std::max<std::size_t>(1, points.size() / kMostPoints);
  const double inverse = 1.0 / leaf_size_m_;
  std::size_t asked = 0, met = 0;
  for (std::size_t i = 0; i < points.size(); i += stride) {
    const Eigen::Vector3d p = T_place_query * points[i].cast<double>();
    ++asked;
    bool any = false;
    for (int corner = 0; corner < 8 && !any; ++corner) {
      const Eigen::Vector3d half(corner & 1, (corner >> 1) & 1, corner >> 2);
      const Eigen::Vector3d at = p + leaf_size_m_ * (half.array() - 0.5).matrix();
      any = IsVoxelKeyInRange(at, inverse) &&
            index_.Find(VoxelKeyOf(at, inverse)) != VoxelIndex::kNone;
    }
    met += any ? 1 : 0;
  }
  return asked == 0 ? 0.0 : static_cast<double>(met) / static_cast<double>(asked);
}

}  // namespace lamina
