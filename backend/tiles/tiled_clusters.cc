#include "backend/tiles/tiled_clusters.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/base/parallel.h"
#include "core/geometry/state_archive.h"
#include "core/map/root_key.h"

namespace lamina {
namespace {

constexpr std::size_t kKeyframesAtOnce = 32;
constexpr std::size_t kBufferBytes = std::size_t{64} << 20;
// Keyframes that follow one another are read by one process; so many tiles are dealt out at a time.
constexpr std::size_t kRun = 32, kTilesOfPart = 4;

// Calls work(keyframe, clusters, slot) for these keyframes, some at once, then take(keyframe, slot)
// in their order.
template <typename Work, typename Take>
void ForKeyframes(const KeyframeSource& source, const std::vector<std::size_t>& keyframes,
                  const Work& work, const Take& take) {
  std::vector<std::vector<PackedCluster>> clusters(kKeyframesAtOnce);
  for (std::size_t begin = 0; begin < keyframes.size(); begin += kKeyframesAtOnce) {
    const std::size_t count = std::min(kKeyframesAtOnce, keyframes.size() - begin);
    for (std::size_t slot = 0; slot < count; ++slot) {
      clusters[slot] = source.Read(keyframes[begin + slot]);
    }
    ParallelChunks(count, 1, [&](std::size_t slot, std::size_t) {
      work(keyframes[begin + slot], clusters[slot], slot);
    });
    for (std::size_t slot = 0; slot < count; ++slot) take(keyframes[begin + slot], slot);
  }
}

}  // namespace

struct TiledClusters::Reach {
  std::vector<std::int32_t> x, y;
  std::vector<std::uint32_t> clusters;

  void Archive(StateArchive& a) { a(&x, &y, &clusters); }
};

TiledClusters::TiledClusters(const KeyframeSource& source, const std::vector<SE3>& poses,
                             const VoxelMapOptions& map, double tile_size_m,
                             const WorkSharing& sharing, const MakeStore& make_store)
    : root_size_m_(map.root_size_m),
      tile_m_(std::max(1.0, std::round(tile_size_m / map.root_size_m)) * map.root_size_m),
      sharing_(sharing),
      store_(make_store()) {
  const std::vector<Reach> reaches = Count(source, poses);
  std::map<TileXY, std::uint64_t> counts;
  for (const Reach& reach : reaches) {
    for (std::size_t i = 0; i < reach.x.size(); ++i)
      counts[{reach.x[i], reach.y[i]}] += reach.clusters[i];
  }
  for (const auto& [tile, count] : counts) {
    number_.emplace(tile, counts_.size());
    counts_.push_back(count);
  }
  DealOut();
  Store(source, poses, reaches);
}

bool TiledClusters::TileOf(const PackedCluster& cluster, const Eigen::Matrix3d& R,
                           const Eigen::Vector3d& t, TileXY* tile) const {
  const Eigen::Vector3d p = R * Eigen::Map<const Eigen::Vector3f>(cluster.mean).cast<double>() + t;
  if (cluster.Empty() || !IsRootKeyInRange(p, 1.0 / root_size_m_)) return false;
  *tile = {static_cast<std::int32_t>(std::floor(p.x() / tile_m_)),
           static_cast<std::int32_t>(std::floor(p.y() / tile_m_))};
  return true;
}

std::vector<TiledClusters::Reach> TiledClusters::Count(const KeyframeSource& source,
                                                       const std::vector<SE3>& poses) const {
  std::vector<std::size_t> owner;
  for (std::size_t k = 0; k < source.size(); ++k) owner.push_back(k / kRun % sharing_.parts);
  return ShareOut<Reach>(owner, sharing_, [&](const std::vector<std::size_t>& mine) {
    std::vector<Reach> reaches, slots(kKeyframesAtOnce);
    ForKeyframes(
        source, mine,
        [&](std::size_t k, const std::vector<PackedCluster>& clusters, std::size_t slot) {
          const Eigen::Matrix3d R = poses[k].R();
          std::map<TileXY, std::uint32_t> counts;
          TileXY tile;
          for (const PackedCluster& cluster : clusters) {
            if (TileOf(cluster, R, poses[k].t, &tile)) ++counts[tile];
          }
          slots[slot] = Reach();
          for (const auto& [index, count] : counts) {
            slots[slot].x.push_back(index.first);
            slots[slot].y.push_back(index.second);
            slots[slot].clusters.push_back(count);
          }
        },
        [&](std::size_t, std::size_t slot) { reaches.push_back(slots[slot]); });
    return reaches;
  });
}

std::size_t TiledClusters::BatchEnd(std::size_t begin) const {
  return std::min(size(), begin + kTilesOfPart * sharing_.parts);
}

void TiledClusters::DealOut() {
  owner_.assign(size(), 0);
  std::vector<std::uint64_t> load(sharing_.parts, 0);
  for (std::size_t begin = 0; begin < size(); begin = BatchEnd(begin)) {
    std::vector<std::size_t> tiles;
    for (std::size_t tile = begin; tile < BatchEnd(begin); ++tile) tiles.push_back(tile);
    std::stable_sort(tiles.begin(), tiles.end(),
                     [&](std::size_t a, std::size_t b) { return counts_[a] > counts_[b]; });
    for (const std::size_t tile : tiles) {
      owner_[tile] =
          static_cast<std::size_t>(std::min_element(load.begin(), load.end()) - load.begin());
      load[owner_[tile]] += counts_[tile];
    }
  }
}

std::vector<std::size_t> TiledClusters::Own(std::size_t part) const {
  std::vector<std::size_t> own;
  for (std::size_t tile = 0; tile < size(); ++tile) {
    if (owner_[tile] == part) own.push_back(tile);
  }
  return own;
}

void TiledClusters::Store(const KeyframeSource& source, const std::vector<SE3>& poses,
                          const std::vector<Reach>& reaches) {
  segments_.resize(size());
  buffers_.resize(size());
  std::vector<std::size_t> reaching;
  for (std::size_t k = 0; k < reaches.size(); ++k) {
    for (std::size_t i = 0; i < reaches[k].x.size(); ++i) {
      if (owner_[number_.at({reaches[k].x[i], reaches[k].y[i]})] != sharing_.part) continue;
      reaching.push_back(k);
      break;
    }
  }
  std::vector<std::map<std::size_t, std::vector<PackedCluster>>> slots(kKeyframesAtOnce);
  ForKeyframes(
      source, reaching,
      [&](std::size_t k, const std::vector<PackedCluster>& clusters, std::size_t slot) {
        const Eigen::Matrix3d R = poses[k].R();
        slots[slot].clear();
        TileXY index;
        for (const PackedCluster& cluster : clusters) {
          if (!TileOf(cluster, R, poses[k].t, &index)) continue;
          const std::size_t tile = number_.at(index);
          if (owner_[tile] == sharing_.part) slots[slot][tile].push_back(cluster);
        }
      },
      [&](std::size_t k, std::size_t slot) {
        for (const auto& [tile, clusters] : slots[slot]) {
          const std::size_t before = buffers_[tile].size();
          const std::uint32_t head[2] = {static_cast<std::uint32_t>(k),
                                         static_cast<std::uint32_t>(clusters.size())};
          buffers_[tile].append(reinterpret_cast<const char*>(head), sizeof(head));
          buffers_[tile].append(reinterpret_cast<const char*>(clusters.data()),
                                clusters.size() * sizeof(PackedCluster));
          buffered_ += buffers_[tile].size() - before;
        }
        if (buffered_ > kBufferBytes) Flush();
      });
  Flush();
}

void TiledClusters::Flush() {
  for (std::size_t tile = 0; tile < size(); ++tile) {
    if (buffers_[tile].empty()) continue;
    segments_[tile].push_back(PutAside(buffers_[tile], store_.get()));
    buffers_[tile] = std::string();
  }
  buffered_ = 0;
}

std::vector<TiledClusters::Share> TiledClusters::Read(std::size_t tile) const {
  std::vector<Share> shares;
  for (const StoredBytes& segment : segments_[tile]) {
    const std::string bytes = TakeBack(segment, *store_);
    std::uint32_t head[2];
    for (std::size_t at = 0; at < bytes.size();) {
      std::memcpy(head, bytes.data() + at, sizeof(head));
      at += sizeof(head);
      Share share{static_cast<std::int32_t>(head[0]), std::vector<PackedCluster>(head[1])};
      std::memcpy(share.clusters.data(), bytes.data() + at, head[1] * sizeof(PackedCluster));
      at += head[1] * sizeof(PackedCluster);
      shares.push_back(std::move(share));
    }
  }
  return shares;
}

}  // namespace lamina
