#include "tools/watch/live/map_queries.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace lamina {
namespace {

constexpr double kMostRadiusM = 200.0;
constexpr std::chrono::seconds kPatience{10};

// Work, in units of what it takes to look at a tile and show a dozen surfels: some 10 us.
constexpr std::size_t kSurfelsPerUnit = 12;
constexpr std::size_t kStoredTileUnits = 32;  // read from the disk
constexpr std::size_t kSliceUnits = 128;
constexpr std::size_t kPageUnits = 2048;

}  // namespace

MapAnswer::MapAnswer(const VoxelMap& map, int min_frames, const MapQuery& query)
    : map_(map), min_frames_(min_frames), query_(query) {
  page_.version = map.refreshes();
  page_.cell_size_m = map.TileSize();
  if (!map.CanHold(query.centre) || !map.HasPiece(query.piece)) return;
  walk_ =
      std::make_unique<TileIndex::Walk>(*map.tiles(query.piece), page_.cell_size_m, query.centre,
                                        std::min(query.radius_m, kMostRadiusM), query.newer_than,
                                        static_cast<std::uint32_t>(query.page));
}

bool MapAnswer::Continue() {
  if (!walk_) return true;
  TileIndex::Walk::Tile tile;
  for (const std::size_t end = work_ + kSliceUnits; work_ < end;) {
    if (!walk_->Next(&tile)) return true;
    // The next page begins at a rank: tiles of the same one stay together.
    if (work_ >= kPageUnits && tile.rank != last_rank_) {
      page_.next = tile.rank;
      return true;
    }
    last_rank_ = tile.rank;
    work_ += AddCell(tile);
  }
  return false;
}

// Returns the work that it was.
std::size_t MapAnswer::AddCell(const TileIndex::Walk::Tile& tile) {
  // It may have been dropped since the last slice.
  if (!map_.HasPiece(query_.piece)) return 1;
  MapCell cell{tile.place.x(), tile.place.y(), tile.place.z(), {}};
  const VoxelKey key = map_.TileAt(tile.place, query_.piece);
  map_.ForEachSurfaceOfTile(key, -1, min_frames_,
                            [&](const Surfel& surfel) { cell.surfels.push_back(surfel); });
  const std::size_t work =
      1 + cell.surfels.size() / kSurfelsPerUnit + (map_.IsStored(key) ? kStoredTileUnits : 0);
  // An empty cell is news for those who have had one with surfels.
  if (query_.newer_than >= 0 || !cell.surfels.empty()) page_.cells.push_back(std::move(cell));
  return work;
}

MapPage MapQueries::Ask(const MapQuery& query) {
  const auto question = std::make_shared<Question>();
  question->query = query;
  std::unique_lock<std::mutex> lock(mutex_);
  waiting_.push_back(question);
  lock.unlock();
  wake_();
  lock.lock();
  if (changed_.wait_for(lock, kPatience, [&] { return question->answered; })) {
    return std::move(question->page);
  }
  waiting_.erase(std::remove(waiting_.begin(), waiting_.end(), question), waiting_.end());
  throw std::runtime_error("the mapping has no time for questions about the map");
}

bool MapQueries::AnswerSlice(const VoxelMap& map, int min_frames) {
  std::unique_lock<std::mutex> lock(mutex_);
  if (waiting_.empty()) return false;
  const std::shared_ptr<Question> question = waiting_.front();
  lock.unlock();
  if (!question->answer) {
    question->answer = std::make_unique<MapAnswer>(map, min_frames, question->query);
  }
  if (!question->answer->Continue()) return true;
  lock.lock();
  question->page = question->answer->TakePage();
  question->answered = true;
  // Who asked may have lost patience, and taken it away.
  if (!waiting_.empty() && waiting_.front() == question) waiting_.pop_front();
  const bool more = !waiting_.empty();
  lock.unlock();
  changed_.notify_all();
  return more;
}

}  // namespace lamina
