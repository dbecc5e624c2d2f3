#include "backend/submaps/map_assembly.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/map/voxel_key.h"

namespace lamina {
namespace {

// Sums by leaf, in the order in which leaves are met. A leaf that has a mean within `radius_m` of
// `at` has all that lies in it.
class LeafSums {
 public:
  LeafSums(const VoxelMapOptions& map, const Eigen::Vector3d& at, double radius_m)
      : inverse_leaf_(1.0 / map.LeafSize()),
        max_weight_(map.max_fixed_weight),
        at_(at),
        reach_m_(radius_m + std::sqrt(3.0) * map.LeafSize()) {}

  // Of one submap after the other.
  void Add(const PlacedSubmap& placed) {
    const Submap& submap = *placed.submap;
    const Eigen::Matrix3d R = placed.T_world_submap.R();
    const auto last = static_cast<std::int32_t>(submap.keyframes.back().id);
    EndSubmap();
    for (const SubmapLeaf& leaf : submap.Leaves()) {
      const PointCluster cluster = submap.Cluster(leaf).Moved(R, placed.T_world_submap.t);
      if ((cluster.mean - at_).norm() > reach_m_) continue;
      if (!IsVoxelKeyInRange(cluster.mean, inverse_leaf_)) continue;
      const auto next = static_cast<std::int32_t>(sums_.size());
      const std::int32_t at = index_.FindOrInsert(VoxelKeyOf(cluster.mean, inverse_leaf_), next);
      if (at == next) sums_.push_back({});
      Sum& sum = sums_[static_cast<std::size_t>(at)];
      if (sum.of_submap.Empty()) touched_.push_back(static_cast<std::size_t>(at));
      sum.of_submap += cluster;
      // Frames of neighbouring leaves of one submap are largely the same ones.
      sum.frames_of_submap = std::max<std::int32_t>(sum.frames_of_submap, leaf.keyframes);
      sum.part.last_frame = last;
    }
  }

  std::vector<VoxelMap::FixedPart> Take() {
    EndSubmap();
    std::vector<VoxelMap::FixedPart> parts;
    parts.reserve(sums_.size());
    for (const Sum& sum : sums_) parts.push_back(sum.part);
    return parts;
  }

 private:
  struct Sum {
    VoxelMap::FixedPart part;
    PointCluster of_submap;
    std::int32_t frames_of_submap = 0;
  };

  void EndSubmap() {
    for (const std::size_t i : touched_) {
      Sum& sum = sums_[i];
      sum.part.cluster += std::exchange(sum.of_submap, {}).Capped(max_weight_);
      sum.part.cluster = sum.part.cluster.Capped(max_weight_);
      sum.part.frames += std::exchange(sum.frames_of_submap, 0);
    }
    touched_.clear();
  }

  double inverse_leaf_, max_weight_;
  Eigen::Vector3d at_;
  double reach_m_;
  VoxelIndex index_;
  std::vector<Sum> sums_;
  std::vector<std::size_t> touched_;
};

}  // namespace

void AddLeaves(const Submap& submap, const SubmapLeaves& leaves, const SE3& T_map_submap,
               VoxelMap* map) {
  const Eigen::Matrix3d R = T_map_submap.R();
  for (const SubmapLeaf& leaf : leaves) {
    const PointCluster cluster = submap.Cluster(leaf).Moved(R, T_map_submap.t);
    if (map->CanHold(cluster.mean))
      map->AddFixed(map->LeafAt(cluster.mean), cluster, leaf.keyframes, submap.keyframes.back().id);
  }
}

std::vector<VoxelMap::FixedPart> SumByLeaf(const std::vector<PlacedSubmap>& submaps,
                                           const VoxelMapOptions& map, const Eigen::Vector3d& at,
                                           double radius_m) {
  LeafSums sums(map, at, radius_m);
  for (const PlacedSubmap& placed : submaps) sums.Add(placed);
  return sums.Take();
}

std::vector<VoxelMap::FixedPart> AssembleFixed(const std::vector<PlacedSubmap>& submaps,
                                               const VoxelMapOptions& map,
                                               const Eigen::Vector3d& sensor) {
  const std::vector<VoxelMap::FixedPart> parts =
      SumByLeaf(submaps, map, sensor, std::numeric_limits<double>::infinity());
  // By rings of so many metres, from the outermost in: leaves that lie together stay together.
  constexpr double kRingM = 10.0;
  std::vector<std::pair<double, std::size_t>> by_ring;
  by_ring.reserve(parts.size());
  for (std::size_t i = 0; i < parts.size(); ++i)
    by_ring.emplace_back(-std::floor((parts[i].cluster.mean - sensor).norm() / kRingM), i);
  std::sort(by_ring.begin(), by_ring.end());
  std::vector<VoxelMap::FixedPart> sorted;
  sorted.reserve(parts.size());
  for (const auto& [ring, i] : by_ring) sorted.push_back(parts[i]);
  return sorted;
}

}  // namespace lamina
