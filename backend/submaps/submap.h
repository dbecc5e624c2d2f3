// A submap: the part of the map that successive keyframes saw, in a frame of its own.
//
//     p_world = T_world_submap * p_submap,      p_submap = T_submap_lidar * p_lidar
//
// Clusters lie in a grid of voxels ("leaves") of the submap's frame, which is that of its first
// keyframe's LiDAR at the time when it left the sliding window. What a submap holds never changes;
// only its anchor T_world_submap may move, so that a correction of the map costs O(submaps).
// Each keyframe belongs to exactly one submap: nothing is counted twice.
//
// A leaf takes 48 bytes: its index, the number of its keyframes, and its cluster in single
// precision, relative to the voxel's centre (mean) and to the number of points (covariance), so
// that it is as exact far from the origin as near it.
#pragma once

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "backend/submaps/final_keyframe.h"
#include "core/base/byte_store.h"
#include "core/geometry/packed_cluster.h"
#include "core/geometry/point_cluster.h"
#include "core/geometry/scan.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_key.h"
#include "core/options/options.h"

namespace lamina {

struct SubmapOptions {
  // Way of the sensor that makes a submap.
  double length_m = 30.0;
  // A sensor that turns on the spot or stands still ends one after so many keyframes, too.
  int max_keyframes = 400;

  void Visit(OptionVisitor& v);
};

struct SubmapLeaf {
  std::int16_t index[3] = {0, 0, 0};  // voxel [index, index + 1) * leaf_size_m
  std::uint16_t keyframes = 0;        // that have points in it, saturating
  PackedCluster cluster;              // relative to the voxel's centre
};
static_assert(sizeof(SubmapLeaf) == 48);
template <>
inline constexpr bool kPlainState<SubmapLeaf> = true;

struct SubmapKeyframe {
  std::int64_t id = 0;
  StampNs stamp_ns = 0;
  SE3 T_submap_lidar;

  void Archive(StateArchive& a) { a(&id, &stamp_ns, &T_submap_lidar); }
};

// The leaves of a submap while they are looked at.
class SubmapLeaves {
 public:
  // Of what lives longer.
  explicit SubmapLeaves(const std::vector<SubmapLeaf>& leaves) : there_(&leaves) {}
  explicit SubmapLeaves(std::vector<SubmapLeaf>&& leaves) : own_(std::move(leaves)) {}

  std::size_t size() const { return all().size(); }
  const SubmapLeaf& operator[](std::size_t i) const { return all()[i]; }
  auto begin() const { return all().begin(); }
  auto end() const { return all().end(); }

 private:
  const std::vector<SubmapLeaf>& all() const { return there_ != nullptr ? *there_ : own_; }

  std::vector<SubmapLeaf> own_;
  const std::vector<SubmapLeaf>* there_ = nullptr;
};

struct Submap {
  std::int64_t id = 0;  // in its piece, from 0
  double leaf_size_m = 0.0;
  SE3 T_world_submap;  // the anchor
  std::vector<SubmapKeyframe> keyframes;
  std::vector<SubmapLeaf> leaves;  // in ascending order of x, y, z; empty once they are stored
  double way_m = 0.0;              // of the sensor in it, to the next submap's first keyframe

  // Where the leaves are when they have left memory; the store outlives the submap.
  const ByteStore* store = nullptr;
  StoredBytes stored;

  // The leaves, wherever they are. Those that come back damaged are none: what the submap held is
  // lost, the rest of the map is not.
  SubmapLeaves Leaves() const;
  std::size_t LeafCount() const;
  // Copies the leaves into a store; they stay in memory until Release(), which does nothing if
  // they are in none.
  void StoreIn(ByteStore* bytes);
  void Release();
  // The cluster of a leaf, in the submap's frame.
  PointCluster Cluster(const SubmapLeaf& leaf) const;

  // With all leaves.
  void Archive(StateArchive& a);
  // Without those that are in a store: this one, when reading.
  void ArchiveBeside(const ByteStore* bytes, StateArchive& a);
};

// Of submaps of one piece: whether `next` began where this one ended; false where those between
// them were trimmed (backend/loops/submap_trimming.h).
inline bool Follows(const Submap& next, const Submap& submap) { return next.id == submap.id + 1; }

// Gathers keyframes of one piece into submaps. Deterministic; not thread-safe.
class SubmapBuilder {
 public:
  // Throws OptionError. leaf_size_m > 0.
  SubmapBuilder(const SubmapOptions& options, double leaf_size_m);

  // Returns the submap that was complete before this keyframe, which begins the next. Clusters
  // farther from the submap's origin than its indices reach (2^15 leaves) are left out.
  std::optional<Submap> Add(const FinalKeyframe& keyframe);
  // What has come since the last complete one, as a submap; without keyframes if nothing has.
  Submap Current() const;
  // The same, if anything; and begins the next.
  std::optional<Submap> Finish();

  void Archive(StateArchive& a);

 private:
  void AddClusters(const FinalKeyframe& keyframe);
  // The cell around a point of the submap's frame, made if it is not there; kNone out of reach.
  std::int32_t CellAt(const Eigen::Vector3d& p);
  Submap Complete();
  std::vector<SubmapLeaf> Leaves() const;

  struct Cell {
    std::int16_t index[3];
    std::uint16_t keyframes = 0;
    std::int64_t last = -1;
    PointCluster in_world;  // turned when the submap is complete: once a cell, not once a cluster
  };
  static void Prefetch(const Cell& cell) {
    constexpr std::size_t kCacheLine = 64;
    const char* const bytes = reinterpret_cast<const char*>(&cell);
    for (std::size_t i = 0; i < sizeof(Cell); i += kCacheLine) __builtin_prefetch(bytes + i);
  }

  SubmapOptions options_;
  double leaf_size_m_;
  Submap submap_;
  std::vector<Cell> cells_;
  VoxelIndex index_;
  SE3 T_world_last_;
};

}  // namespace lamina
