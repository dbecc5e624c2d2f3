#include "backend/localisation/map_places.h"

#include <algorithm>
#include <cmath>

#include "backend/submaps/map_assembly.h"

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

SE3 PlaceFrame(const MapPlace& place, const VoxelMapOptions& map) {
  SE3 frame;
  frame.t = map.root_size_m * (place.at / map.root_size_m).array().round().matrix();
  return frame;
}

namespace {

// Gathers clusters of a piece's frame around a place.
class PlaceBuilder {
 public:
  PlaceBuilder(const MapPlace& place, double radius_m, const VoxelMapOptions& map)
      : at_(place.at), radius_m_(radius_m), inverse_leaf_(1.0 / map.LeafSize()) {
    submap_.leaf_size_m = map.LeafSize();
    submap_.T_world_submap = PlaceFrame(place, map);
    SubmapKeyframe keyframe;
    keyframe.T_submap_lidar.t = place.at - submap_.T_world_submap.t;
    submap_.keyframes.push_back(keyframe);
  }

  void Add(const PointCluster& cluster, int frames) {
    const Eigen::Vector3d p = cluster.mean - submap_.T_world_submap.t;
    if ((cluster.mean - at_).norm() > radius_m_) return;
    SubmapLeaf leaf;
    leaf.keyframes = static_cast<std::uint16_t>(std::min(frames, 65535));
    Eigen::Vector3d centre;
    for (int axis = 0; axis < 3; ++axis) {
      leaf.index[axis] = static_cast<std::int16_t>(std::floor(p[axis] * inverse_leaf_));
      centre[axis] = submap_.leaf_size_m * (leaf.index[axis] + 0.5);
    }
    PointCluster moved = cluster;
    moved.mean = p;
    leaf.cluster = PackedCluster::Of(moved, centre);
    submap_.leaves.push_back(leaf);
  }

  Submap Take() {
    std::sort(submap_.leaves.begin(), submap_.leaves.end(),
              [](const SubmapLeaf& a, const SubmapLeaf& b) {
                return std::lexicographical_compare(a.index, a.index + 3, b.index, b.index + 3);
              });
    return std::move(submap_);
  }

 private:
  Eigen::Vector3d at_;
  double radius_m_, inverse_leaf_;
  Submap submap_;
};

}  // namespace

Submap SubmapAround(const MapPlace& place, double radius_m, const VoxelMap& map) {
  PlaceBuilder builder(place, radius_m, map.options());
  const double tile_m = map.TileSize();
  const Eigen::Array3d low = ((place.at.array() - radius_m) / tile_m).floor();
  const Eigen::Array3d high = ((place.at.array() + radius_m) / tile_m).floor();
  const auto add = [&](const PointCluster& cluster, int frames) { builder.Add(cluster, frames); };
  for (double x = low.x(); x <= high.x(); ++x) {
    for (double y = low.y(); y <= high.y(); ++y) {
      for (double z = low.z(); z <= high.z(); ++z) {
        if (!map.CanHold(tile_m * (Eigen::Vector3d(x, y, z).array() + 0.5).matrix())) continue;
        const Eigen::Vector3i tile(static_cast<int>(x), static_cast<int>(y), static_cast<int>(z));
        map.ForEachLeafOfTile(map.TileAt(tile, place.piece), add);
      }
    }
  }
  return builder.Take();
}

Submap PlaceSource::Around(const MapPlace& place, double radius_m) const {
  if (map_ != nullptr) return SubmapAround(place, radius_m, *map_);
  const LoopClosure& closure = *pieces_.at(place.piece);
  std::vector<PlacedSubmap> near;
  for (std::size_t i = 0; i < closure.submaps().size(); ++i) {
    const Submap& submap = closure.submaps()[i];
    const SE3& anchor = closure.anchors()[i];
    const auto within = [&](const SubmapKeyframe& keyframe) {
      return (anchor * keyframe.T_submap_lidar.t - place.at).norm() <= radius_m;
    };
    if (std::any_of(submap.keyframes.begin(), submap.keyframes.end(), within))
      near.push_back({&submap, anchor});
  }
  PlaceBuilder builder(place, radius_m, options_);
  for (const VoxelMap::FixedPart& part : SumByLeaf(near, options_, place.at, radius_m))
    builder.Add(part.cluster, part.frames);
  return builder.Take();
}

}  // namespace lamina
