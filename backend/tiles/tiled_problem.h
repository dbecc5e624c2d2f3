// The planes that keyframes see together at given poses, tile by tile: what BatchCast
// (backend/registration/batch_cast.h) makes of the clusters of a tile. A tile's planes and their
// observations are put into a store, and read whenever they are needed: a process holds some tiles
// at once.
//
// A plane that very many keyframes see couples all of them with one another. Beyond
// most_observations, observations of keyframes that follow one another are summed, at the poses of
// the association, into that of the one with most points among them: it then speaks for them.
//
// Private to backend/tiles.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "backend/bundle/problem.h"
#include "backend/tiles/tiled_clusters.h"
#include "backend/window/sliding_window.h"

namespace lamina {

// Of one tile: frames of `bundle` are numbered among those that see something in it.
struct TileProblem {
  std::vector<std::int32_t> frames;  // the keyframe of each, ascending
  BundleProblem bundle;              // poses empty
};

// Sums observations of planes that more frames have seen (see above).
void SumBeyond(std::size_t most_observations, const std::vector<SE3>& poses,
               BundleProblem* problem);

class TiledProblem {
 public:
  struct Options {
    VoxelMapOptions map;
    SlidingWindowOptions weights;
    std::size_t most_observations = 0;  // of a plane; 0: any number
  };
  // All processes of `sharing` do this together.
  TiledProblem(const TiledClusters& clusters, const std::vector<SE3>& poses, const Options& options,
               const WorkSharing& sharing, const MakeStore& make_store);

  const TiledClusters& tiles() const { return tiles_; }
  // Of all tiles of all processes.
  std::uint64_t planes() const { return planes_; }
  std::uint64_t observations() const { return observations_; }
  // A tile of this process. Not thread-safe.
  TileProblem Read(std::size_t tile) const;

 private:
  const TiledClusters& tiles_;
  std::unique_ptr<ByteStore> store_;
  std::vector<StoredBytes> places_;  // of each tile
  std::uint64_t planes_ = 0, observations_ = 0;
};

// The misfit of all clusters (BatchCast::Misfit), at the poses by which the tiles were made.
double TiledMisfit(const TiledClusters& clusters, const std::vector<SE3>& poses,
                   const VoxelMapOptions& map, const SlidingWindowOptions& weights,
                   const WorkSharing& sharing);

}  // namespace lamina
