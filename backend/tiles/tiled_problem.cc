#include "backend/tiles/tiled_problem.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>
#include <utility>

#include "backend/registration/batch_cast.h"
#include "backend/tiles/tile_loop.h"

namespace lamina {
namespace {

// The keyframes of a tile as a batch.
struct TileBatch {
  std::vector<std::int32_t> keyframes;
  std::vector<BatchFrame> frames;
  std::vector<SE3> poses;

  TileBatch(const std::vector<TiledClusters::Share>& shares, const std::vector<SE3>& all) {
    for (const TiledClusters::Share& share : shares) {
      std::vector<TimedCluster> clusters(share.clusters.size());
      for (std::size_t i = 0; i < clusters.size(); ++i)
        clusters[i].points = share.clusters[i].Unpacked(Eigen::Vector3d::Zero());
      BatchFrame frame;
      frame.T_world_lidar = all[static_cast<std::size_t>(share.keyframe)];
      frame.clusters = clusters;
      keyframes.push_back(share.keyframe);
      poses.push_back(frame.T_world_lidar);
      frames.push_back(std::move(frame));
    }
  }
};

// Frames that see no plane are left out.
TileProblem Compact(const std::vector<std::int32_t>& keyframes, BundleProblem problem) {
  TileProblem tile;
  std::vector<std::int32_t> number(keyframes.size(), -1);
  for (const PlaneObservation& o : problem.observations) {
    number[static_cast<std::size_t>(o.frame)] = 0;
  }
  for (std::size_t k = 0; k < keyframes.size(); ++k) {
    if (number[k] < 0) continue;
    number[k] = static_cast<std::int32_t>(tile.frames.size());
    tile.frames.push_back(keyframes[k]);
  }
  for (PlaneObservation& o : problem.observations) {
    o.frame = number[static_cast<std::size_t>(o.frame)];
  }
  tile.bundle = std::move(problem);
  tile.bundle.poses.clear();
  tile.bundle.hold_first_pose = false;
  return tile;
}

void ArchiveTile(StateArchive& a, TileProblem* tile) {
  BundleProblem& bundle = tile->bundle;
  std::vector<std::int32_t> counts, frames;
  std::vector<double> weights;
  std::vector<PointCluster> clusters;
  for (const Plane& plane : bundle.planes) {
    counts.push_back(plane.count);
    weights.push_back(plane.weight);
  }
  for (const PlaneObservation& o : bundle.observations) {
    frames.push_back(o.frame);
    clusters.push_back(o.cluster);
  }
  a(&tile->frames, &counts, &weights, &frames, &clusters);
  if (!a.reading()) return;
  std::int32_t first = 0;
  for (std::size_t p = 0; p < counts.size(); ++p) {
    Plane plane;
    plane.first = first;
    plane.count = counts[p];
    plane.weight = weights[p];
    first += plane.count;
    bundle.planes.push_back(plane);
  }
  for (std::size_t o = 0; o < frames.size(); ++o) {
    bundle.observations.push_back({frames[o], clusters[o]});
  }
  bundle.hold_first_pose = false;
}

// Figures of a process' tiles.
struct TileCounts {
  std::uint64_t planes = 0, observations = 0;

  void Archive(StateArchive& a) { a(&planes, &observations); }
};

}  // namespace

void SumBeyond(std::size_t most_observations, const std::vector<SE3>& poses,
               BundleProblem* problem) {
  std::vector<PlaneObservation> kept;
  for (Plane& plane : problem->planes) {
    const auto first = static_cast<std::size_t>(plane.first);
    const auto count = static_cast<std::size_t>(plane.count);
    const std::size_t groups = std::min(count, most_observations);
    plane.first = static_cast<std::int32_t>(kept.size());
    plane.count = static_cast<std::int32_t>(groups);
    for (std::size_t g = 0; g < groups; ++g) {
      const std::size_t begin = first + g * count / groups, end = first + (g + 1) * count / groups;
      std::size_t most = begin;
      for (std::size_t o = begin; o < end; ++o) {
        if (problem->observations[o].cluster.count > problem->observations[most].cluster.count)
          most = o;
      }
      PlaneObservation sum = problem->observations[most];
      const SE3 T_own_world = poses[static_cast<std::size_t>(sum.frame)].Inverse();
      for (std::size_t o = begin; o < end; ++o) {
        if (o == most) continue;
        const PlaneObservation& other = problem->observations[o];
        const SE3 T = T_own_world * poses[static_cast<std::size_t>(other.frame)];
        sum.cluster += other.cluster.Moved(T.R(), T.t);
      }
      kept.push_back(sum);
    }
  }
  problem->observations = std::move(kept);
}

TiledProblem::TiledProblem(const TiledClusters& clusters, const std::vector<SE3>& poses,
                           const Options& options, const WorkSharing& sharing,
                           const MakeStore& make_store)
    : tiles_(clusters), store_(make_store()), places_(clusters.size()) {
  SlidingWindowOptions weights = options.weights;
  weights.max_planes = std::numeric_limits<std::int32_t>::max();
  TileCounts mine;
  ForTiles<std::vector<TiledClusters::Share>, TileProblem>(
      clusters.Own(sharing.part), [&](std::size_t tile) { return clusters.Read(tile); },
      [&](std::size_t, const std::vector<TiledClusters::Share>& shares) {
        const TileBatch batch(shares, poses);
        BundleProblem problem =
            BatchCast(batch.frames, batch.poses, options.map, weights).Problem(false);
        if (options.most_observations > 0)
          SumBeyond(options.most_observations, batch.poses, &problem);
        return Compact(batch.keyframes, std::move(problem));
      },
      [&](std::size_t tile, TileProblem* problem) {
        mine.planes += problem->bundle.planes.size();
        mine.observations += problem->bundle.observations.size();
        StateArchive archive;
        ArchiveTile(archive, problem);
        places_[tile] = PutAside(archive.written(), store_.get());
      });
  std::vector<std::size_t> each(sharing.parts);
  for (std::size_t part = 0; part < each.size(); ++part) each[part] = part;
  for (const TileCounts& counts : ShareOut<TileCounts>(
           each, sharing, [&](const auto&) { return std::vector<TileCounts>{mine}; })) {
    planes_ += counts.planes;
    observations_ += counts.observations;
  }
}

TileProblem TiledProblem::Read(std::size_t tile) const {
  const std::string bytes = TakeBack(places_[tile], *store_);
  StateArchive archive{std::string_view(bytes)};
  TileProblem problem;
  ArchiveTile(archive, &problem);
  return problem;
}

double TiledMisfit(const TiledClusters& clusters, const std::vector<SE3>& poses,
                   const VoxelMapOptions& map, const SlidingWindowOptions& weights,
                   const WorkSharing& sharing) {
  using Shares = std::vector<TiledClusters::Share>;
  const std::vector<double> misfits = NumberOfEach<Shares>(
      clusters, sharing, [&](std::size_t tile) { return clusters.Read(tile); },
      [&](const Shares& shares) {
        const TileBatch batch(shares, poses);
        return BatchCast(batch.frames, batch.poses, map, weights).Misfit();
      });
  double sum = 0.0, count = 0.0;
  for (std::size_t tile = 0; tile < misfits.size(); ++tile) {
    const auto n = static_cast<double>(clusters.clusters(tile));
    sum += n * misfits[tile] * misfits[tile];
    count += n;
  }
  return count > 0.0 ? std::sqrt(sum / count) : 0.0;
}

}  // namespace lamina
