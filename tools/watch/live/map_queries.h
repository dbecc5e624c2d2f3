// Questions about the map, asked by any thread and answered by the mapping thread between two
// scans, when the map does not change.
//
// The mapping thread answers in slices of a millisecond or two, one after a scan, more while it has
// nothing to map: no question makes a scan wait for a whole page, however large its sphere. An
// answer costs the tiles that it looks at: those that exist (core/map/tile_index.h) and have
// changed.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>

#include "core/map/voxel_map.h"
#include "tools/watch/live/wire.h"

namespace lamina {

// Surfels near a place: the cells (tiles of the map) that touch the sphere, nearest first, so many
// to a page, without those that have not changed since query.newer_than.
class MapAnswer {
 public:
  // The map must track its tiles. `min_frames` as in VoxelMap::ForEachSurface.
  MapAnswer(const VoxelMap& map, int min_frames, const MapQuery& query);

  // Goes on with the page, by the mapping thread. True when it is complete.
  bool Continue();
  MapPage TakePage() { return std::move(page_); }
  // Cubes of the tile index looked at: grows with what is found, not with the sphere.
  std::size_t looked_at() const { return walk_ ? walk_->looked_at() : 0; }

 private:
  std::size_t AddCell(const TileIndex::Walk::Tile& tile);

  const VoxelMap& map_;
  const int min_frames_;
  const MapQuery query_;
  MapPage page_;
  std::unique_ptr<TileIndex::Walk> walk_;
  std::size_t work_ = 0;
  std::uint32_t last_rank_ = 0;
};

// Thread-safe.
class MapQueries {
 public:
  // `wake` is called when a question has come in: the mapping thread may be waiting for scans.
  explicit MapQueries(std::function<void()> wake) : wake_(std::move(wake)) {}

  // Waits for the answer. Throws std::runtime_error if the mapping thread has no time for it.
  MapPage Ask(const MapQuery& query);

  // By the mapping thread: a slice of the answer to the oldest question, if there is any. Whether
  // there is more to do.
  bool AnswerSlice(const VoxelMap& map, int min_frames);

 private:
  struct Question {
    MapQuery query;
    std::unique_ptr<MapAnswer> answer;  // of the mapping thread alone
    MapPage page;
    bool answered = false;
  };
  std::function<void()> wake_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::shared_ptr<Question>> waiting_;
};

}  // namespace lamina
