#include "backend/localisation/place_evidence.h"

#include <algorithm>
#include <cstddef>

#include "core/base/thinning.h"

namespace lamina {
namespace {

// Points that are asked for.
constexpr std::size_t kEnoughPoints = 4000;

// Of the lower of the two leaves, along each axis, that are the nearest to a point.
VoxelKey BlockOf(const Eigen::Vector3i& lower) {
  constexpr double kLeaves = 8.0;
  return VoxelKeyOf(lower.cast<double>(), 1.0 / kLeaves);
}

Eigen::Vector3i Corner(int i) { return {i & 1, (i >> 1) & 1, i >> 2}; }

}  // namespace

OccupiedLeaves::OccupiedLeaves(const Submap& place)
    : leaf_size_m_(place.leaf_size_m), index_(place.leaves.size()) {
  for (const SubmapLeaf& leaf : place.leaves) {
    const Eigen::Vector3i index(leaf.index[0], leaf.index[1], leaf.index[2]);
    index_.Insert(PackVoxelKey(index.x(), index.y(), index.z()));
    for (int corner = 0; corner < 8; ++corner) blocks_.Insert(BlockOf(index - Corner(corner)));
  }
}

double OccupiedLeaves::Met(const std::vector<Eigen::Vector3f>& points,
                           const SE3& T_place_query) const {
  const std::size_t stride = StrideToAtLeast(points.size(), kEnoughPoints);
  const double inverse = 1.0 / leaf_size_m_;
  const Eigen::Matrix3d R = T_place_query.R();
  const Eigen::Vector3d half = Eigen::Vector3d::Constant(0.5 * leaf_size_m_);
  std::size_t asked = 0, met = 0;
  for (std::size_t i = 0; i < points.size(); i += stride) {
    ++asked;
    const Eigen::Vector3d p = R * points[i].cast<double>() + T_place_query.t;
    if (!IsVoxelKeyInRange(p - half, inverse) || !IsVoxelKeyInRange(p + half, inverse)) continue;
    const Eigen::Vector3i lower = (inverse * (p - half)).array().floor().matrix().cast<int>();
    if (blocks_.Find(BlockOf(lower)) == VoxelIndex::kNone) continue;
    bool any = false;
    for (int corner = 0; corner < 8 && !any; ++corner) {
      const Eigen::Vector3i at = lower + Corner(corner);
      any = index_.Find(PackVoxelKey(at.x(), at.y(), at.z())) != VoxelIndex::kNone;
    }
    met += any ? 1 : 0;
  }
  return asked == 0 ? 0.0 : static_cast<double>(met) / static_cast<double>(asked);
}

}  // namespace lamina
