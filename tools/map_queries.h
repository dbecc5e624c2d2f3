// Questions about the map, asked by any thread and answered by the mapping thread between two
// scans, when nobody changes the map.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>

#include "core/voxel_map.h"
#include "tools/live_wire.h"

namespace lamina {

// Surfels near a place: the cells (tiles of the map) that touch the sphere, nearest first, so many
// to a page, without those that have not changed since query.newer_than. For the mapping thread.
MapPage AnswerMapQuery(const VoxelMap& map, int min_frames, const MapQuery& query);

// Thread-safe.
class MapQueries {
 public:
  // `wake` is called when a question has come in: the mapping thread may be waiting for scans.
  explicit MapQueries(std::function<void()> wake) : wake_(std::move(wake)) {}

  // Waits for the answer. Throws std::runtime_error if the mapping thread has no time for it.
  MapPage Ask(const MapQuery& query);

  // By the mapping thread: answers one question, if there is any. Whether there are more.
  bool AnswerOne(const VoxelMap& map, int min_frames);

 private:
  struct Question {
    MapQuery query;
    MapPage answer;
    bool answered = false;
  };
  std::function<void()> wake_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::shared_ptr<Question>> waiting_;
};

}  // namespace lamina
