#include "backend/localisation/map_places.h"

#include <algorithm>
#include <cmath>

namespace lamina {

void AddPlaces(std::int64_t piece, const std::vector<Eigen::Vector3d>& way, double spacing_m,
               std::vector<MapPlace>* places) {
  for (const Eigen::Vector3d& at : way) {
    const bool near = std::any_of(places->rbegin(), places->rend(), [&](const MapPlace& place) {
      return place.piece == piece && (place.at - at).norm() < spacing_m;
    });
    if (!near) places->push_back({piece, at});
  }
}

Submap SubmapAround(const MapPlace& place, double radius_m, const VoxelMap& map) {
  Submap submap;
  submap.leaf_size_m = map.options().LeafSize();
  // On the grid of the map's voxels.
  const double root_m = map.options().root_size_m;
  submap.T_world_submap.t = root_m * (place.at / root_m).array().round().matrix();
  const Eigen::Vector3d origin = submap.T_world_submap.t;
  SubmapKeyframe keyframe;
  keyframe.T_submap_lidar.t = place.at - origin;
  submap.keyframes.push_back(keyframe);
  const double tile_m = map.TileSize();
  const Eigen::Array3d low = ((place.at.array() - radius_m) / tile_m).floor();
  const Eigen::Array3d high = ((place.at.array() + radius_m) / tile_m).floor();
  const double inverse_leaf = 1.0 / submap.leaf_size_m;
  const auto add = [&](const PointCluster& cluster, int frames) {
    const Eigen::Vector3d p = cluster.mean - origin;
    if ((cluster.mean - place.at).norm() > radius_m) return;
    SubmapLeaf leaf;
    leaf.keyframes = static_cast<std::uint16_t>(std::min(frames, 65535));
    Eigen::Vector3d centre;
    for (int axis = 0; axis < 3; ++axis) {
      leaf.index[axis] = static_cast<std::int16_t>(std::floor(p[axis] * inverse_leaf));
      centre[axis] = submap.leaf_size_m * (leaf.index[axis] + 0.5);
    }
    PointCluster moved = cluster;
    moved.mean = p;
    leaf.cluster = PackedCluster::Of(moved, centre);
    submap.leaves.push_back(leaf);
  };
  for (double x = low.x(); x <= high.x(); ++x) {
    for (double y = low.y(); y <= high.y(); ++y) {
      for (double z = low.z(); z <= high.z(); ++z) {
        if (!map.CanHold(tile_m * (Eigen::Vector3d(x, y, z).array() + 0.5).matrix())) continue;
        const Eigen::Vector3i tile(static_cast<int>(x), static_cast<int>(y), static_cast<int>(z));
        map.ForEachLeafOfTile(map.TileAt(tile, place.piece), add);
      }
    }
  }
  std::sort(submap.leaves.begin(), submap.leaves.end(),
            [](const SubmapLeaf& a, const SubmapLeaf& b) {
              return std::lexicographical_compare(a.index, a.index + 3, b.index, b.index + 3);
            });
  return submap;
}

}  // namespace lamina
