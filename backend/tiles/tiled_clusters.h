// The clusters of many keyframes, sorted by where they lie at given poses: by tiles, square columns
// of the world's ground plane, each a whole number of root voxels wide. So a root voxel, and with
// it a plane, lies in one tile, and tiles are independent.
//
//     first pass    each keyframe is read by one process, which counts its clusters by tile
//     dealing out   tiles in ascending order of x, y, some at a time, each to the process that has
//                   fewest clusters so far
//     second pass   each process reads the keyframes that reach its tiles, and puts their
//                   clusters into its store by tile
//
// Memory: that of the counts, of some keyframes, and of a buffer (kBufferBytes).
//
// Private to backend/tiles.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "backend/submaps/work_sharing.h"
#include "backend/tiles/keyframe_source.h"
#include "core/geometry/se3.h"
#include "core/map/voxel_map.h"

namespace lamina {

class TiledClusters {
 public:
  // What a keyframe has in a tile.
  struct Share {
    std::int32_t keyframe = 0;
    std::vector<PackedCluster> clusters;  // as in the source
  };

  // All processes of `sharing` do this together. Deterministic: tiles, their numbers and what they
  // hold do not depend on the number of processes or threads.
  TiledClusters(const KeyframeSource& source, const std::vector<SE3>& poses,
                const VoxelMapOptions& map, double tile_size_m, const WorkSharing& sharing,
                const MakeStore& make_store);

  std::size_t size() const { return counts_.size(); }
  std::size_t owner(std::size_t tile) const { return owner_[tile]; }
  const std::vector<std::size_t>& owners() const { return owner_; }
  std::uint64_t clusters(std::size_t tile) const { return counts_[tile]; }
  // The tiles of this process, ascending.
  std::vector<std::size_t> Own(std::size_t part) const;
  // Tiles [begin, end) that are dealt out at a time: each begins where the last ends.
  std::size_t BatchEnd(std::size_t begin) const;
  // Of a tile of this process: its keyframes, ascending.
  std::vector<Share> Read(std::size_t tile) const;

 private:
  using TileXY = std::pair<std::int32_t, std::int32_t>;  // x, y
  struct Reach;                                          // tiles of a keyframe, and how much

  // That of a cluster; false if no map can hold it.
  bool TileOf(const PackedCluster& cluster, const Eigen::Matrix3d& R, const Eigen::Vector3d& t,
              TileXY* tile) const;
  std::vector<Reach> Count(const KeyframeSource& source, const std::vector<SE3>& poses) const;
  void DealOut();
  void Store(const KeyframeSource& source, const std::vector<SE3>& poses,
             const std::vector<Reach>& reaches);
  void Flush();

  double root_size_m_, tile_m_;
  WorkSharing sharing_;
  std::map<TileXY, std::size_t> number_;
  std::vector<std::uint64_t> counts_;
  std::vector<std::size_t> owner_;
  std::unique_ptr<ByteStore> store_;
  std::vector<std::vector<StoredBytes>> segments_;  // of each tile
  std::vector<std::string> buffers_;
  std::size_t buffered_ = 0;
};

}  // namespace lamina
