#include "tools/map_queries.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace lamina {
namespace {

constexpr std::size_t kTilesPerPage = 2000;
constexpr double kMostRadiusM = 200.0;
constexpr std::chrono::seconds kPatience{10};

struct Tile {
  double distance = 0.0;
  std::int32_t x = 0, y = 0, z = 0;
};

// The tiles that touch a sphere, nearest first.
std::vector<Tile> TilesAround(const MapQuery& query, double size) {
  const double radius = std::min(query.radius_m, kMostRadiusM);
  const Eigen::Vector3d low = (query.centre.array() - radius) / size;
  const Eigen::Vector3d high = (query.centre.array() + radius) / size;
  const auto floor = [](double value) { return static_cast<std::int32_t>(std::floor(value)); };
  std::vector<Tile> tiles;
  for (std::int32_t x = floor(low.x()); x <= floor(high.x()); ++x) {
    for (std::int32_t y = floor(low.y()); y <= floor(high.y()); ++y) {
      for (std::int32_t z = floor(low.z()); z <= floor(high.z()); ++z) {
        const Eigen::Vector3d corner = size * Eigen::Vector3d(x, y, z);
        const Eigen::Vector3d nearest =
            query.centre.cwiseMax(corner).cwiseMin(corner + Eigen::Vector3d::Constant(size));
        const double distance = (nearest - query.centre).norm();
        if (distance <= radius) tiles.push_back({distance, x, y, z});
      }
    }
  }
  std::stable_sort(tiles.begin(), tiles.end(),
                   [](const Tile& a, const Tile& b) { return a.distance < b.distance; });
  return tiles;
}

}  // namespace

MapPage AnswerMapQuery(const VoxelMap& map, int min_frames, const MapQuery& query) {
  MapPage page;
  page.version = map.refreshes();
  page.cell_size_m = map.options().root_size_m * (1 << kTileBits);
  if (!map.CanHold(query.centre) || !map.HasPiece(query.piece)) return page;
  const std::vector<Tile> tiles = TilesAround(query, page.cell_size_m);
  const std::size_t begin = std::min(tiles.size(), query.page * kTilesPerPage);
  const std::size_t end = std::min(tiles.size(), begin + kTilesPerPage);
  page.more = end < tiles.size();
  for (std::size_t i = begin; i < end; ++i) {
    MapCell cell{tiles[i].x, tiles[i].y, tiles[i].z, {}};
    const Eigen::Vector3d centre =
        page.cell_size_m * (Eigen::Vector3d(cell.ix, cell.iy, cell.iz).array() + 0.5);
    if (!map.CanHold(centre)) continue;
    const VoxelKey tile = map.TileAround(centre, query.piece);
    const std::int64_t changed =
        map.ForEachSurfaceOfTile(tile, query.newer_than, min_frames,
                                 [&](const Surfel& surfel) { cell.surfels.push_back(surfel); });
    const bool news = query.newer_than >= 0 && changed > query.newer_than;
    if (news || !cell.surfels.empty()) page.cells.push_back(std::move(cell));
  }
  return page;
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
    return std::move(question->answer);
  }
  waiting_.erase(std::remove(waiting_.begin(), waiting_.end(), question), waiting_.end());
  throw std::runtime_error("the mapping has no time for questions about the map");
}

bool MapQueries::AnswerOne(const VoxelMap& map, int min_frames) {
  std::unique_lock<std::mutex> lock(mutex_);
  if (waiting_.empty()) return false;
  const std::shared_ptr<Question> question = waiting_.front();
  waiting_.pop_front();
  lock.unlock();
  MapPage answer = AnswerMapQuery(map, min_frames, question->query);
  lock.lock();
  question->answer = std::move(answer);
  question->answered = true;
  const bool more = !waiting_.empty();
  lock.unlock();
  changed_.notify_all();
  return more;
}

}  // namespace lamina
