// Which nodes of the map are planes, brought up to date where anything has changed.
#include <algorithm>
#include <utility>

#include "core/base/parallel.h"
#include "core/map/voxel_map.h"

namespace lamina {
namespace {

// Whether l3 > most_l3 or l3 > most_flatness l2 for certain, from the coefficients of the
// characteristic polynomial alone: most nodes without a plane are spared the decomposition. With
//
//     I1 = l1 + l2 + l3    I2 = l1 l2 + l1 l3 + l2 l3    I3 = l1 l2 l3
//
// l3 >= I3 / I2, since I2 >= l1 l2; l2 <= I2 / l1 for the same reason, and l1 >= (I1^2 - 2 I2) / I1
// since the sum of the squares is at most l1 I1.
bool SurelyThick(const Symmetric3& s, double most_l3, double most_flatness) {
  // What is within rounding is decided by the decomposition.
  constexpr double kSure = 1.0 + 1e-9, kRounding = 1e-14;
  const double xy2 = s.xy * s.xy, xz2 = s.xz * s.xz, yz2 = s.yz * s.yz;
  const double i1 = s.Trace();
  const double i2 = s.xx * s.yy - xy2 + s.xx * s.zz - xz2 + s.yy * s.zz - yz2;
  const double i3 = s.xx * (s.yy * s.zz - yz2) - s.zz * xy2 - s.yy * xz2 + 2.0 * s.xy * s.xz * s.yz;
  if (!(i2 > 0.0)) return false;
  const double least_i3 = i3 - kRounding * i1 * i1 * i1;
  const double least_l1 = (i1 * i1 - 2.0 * i2) / i1;
  return least_i3 > kSure * most_l3 * i2 || least_i3 * least_l1 > kSure * most_flatness * i2 * i2;
}

}  // namespace

bool VoxelMap::BeginSurface(const PointCluster& cluster, int frames, Surface* surface) const {
  surface->mean = cluster.mean;
  surface->frames = SaturatingAdd(0, frames);
  if (cluster.count < options_.min_points) return false;
  surface->kind = Surface::Kind::kRough;
  return !SurelyThick(cluster.Covariance(), options_.max_thickness_m * options_.max_thickness_m,
                      options_.max_flatness);
}

void VoxelMap::FinishSurface(const Eigen3& eigen, Surface* surface) const {
  constexpr double kLeastVariance = 1e-8;  // m^2, so that the breadth follows from the flatness
  // m^2: points nearer to one another than this have no direction of their own, as those of a scan
  // that comes again and again without any noise.
  constexpr double kLeastBreadth2 = 1e-6;
  surface->variance = static_cast<float>(std::max(kLeastVariance, eigen.l(2)));
  if (eigen.l(1) > 0.0) surface->flatness = surface->variance / static_cast<float>(eigen.l(1));
  surface->normal = eigen.u.col(2).cast<float>();
  if (eigen.l(2) <= options_.max_thickness_m * options_.max_thickness_m &&
      eigen.l(2) <= options_.max_flatness * eigen.l(1) && eigen.l(1) > kLeastBreadth2 &&
      eigen.l(1) >= options_.min_breadth * eigen.l(0)) {
    surface->kind = Surface::Kind::kPlane;
  }
}

Surface VoxelMap::SurfaceOf(const PointCluster& cluster, int frames) const {
  Surface surface;
  if (BeginSurface(cluster, frames, &surface)) FinishSurface(cluster.EigenPairs(), &surface);
  return surface;
}

void VoxelMap::SumTree(NodeId id, std::vector<TreeSum>* sums) const {
  const std::size_t place = sums->size();
  sums->emplace_back(id);
  if (VoxelTrees::IsLeaf(id)) {
    const MapLeaf& leaf = trees_.leaf(id);
    TreeSum& sum = (*sums)[place];
    if (!leaf.fixed.Empty()) sum.moments = leaf.fixed.Moments();
    if (const ClusterMoments* window = trees_.FindWindow(leaf)) sum.moments += *window;
    sum.frames = leaf.fixed_frames + leaf.window_frames;
  } else {
    const NodeId* child = trees_.children(id);
    for (int slot = 0; slot < 8; ++slot) {
      if (child[slot] == kNoNode) continue;
      const std::size_t of_child = sums->size();
      SumTree(child[slot], sums);
      TreeSum& sum = (*sums)[place];
      sum.moments += (*sums)[of_child].moments;
      // Frames of the children overlap in ways that are not counted; the largest is a sure lower
      // bound.
      sum.frames = std::max(sum.frames, (*sums)[of_child].frames);
    }
  }
  (*sums)[place].end = sums->size();
}

// Nodes of one level of many trees are decomposed together.
struct VoxelMap::RefreshRoom {
  struct Level {
    std::vector<std::size_t> sums;         // to be looked at
    std::vector<Eigen::Vector3d> centres;  // of their roots
  };
  std::vector<TreeSum> sums;
  Level level, next;
  std::vector<std::size_t> doubtful;  // those that need their eigenvalues
  std::vector<Symmetric3> covariances;
  std::vector<Eigen3> eigen;
};

void VoxelMap::FindSurfaces(RefreshRoom* room) const {
  auto& [sums, level, next, doubtful, covariances, eigen] = *room;
  while (!level.sums.empty()) {
    doubtful.clear();
    covariances.clear();
    for (std::size_t k = 0; k < level.sums.size(); ++k) {
      TreeSum& sum = sums[level.sums[k]];
      const PointCluster cluster = sum.moments.Cluster(level.centres[k]);
      if (!BeginSurface(cluster, sum.frames, &sum.surface)) continue;
      doubtful.push_back(level.sums[k]);
      covariances.push_back(cluster.Covariance());
    }
    eigen.resize(doubtful.size());
    EigenDecompose(covariances.data(), doubtful.size(), eigen.data());
    for (std::size_t k = 0; k < doubtful.size(); ++k) {
      FinishSurface(eigen[k], &sums[doubtful[k]].surface);
    }
    next.sums.clear();
    next.centres.clear();
    for (std::size_t k = 0; k < level.sums.size(); ++k) {
      const TreeSum& sum = sums[level.sums[k]];
      if (sum.surface.kind == Surface::Kind::kPlane) continue;
      for (std::size_t child = level.sums[k] + 1; child < sum.end; child = sums[child].end) {
        next.sums.push_back(child);
        next.centres.push_back(level.centres[k]);
      }
    }
    std::swap(level, next);
  }
}

void VoxelMap::PrefetchTrees(std::size_t i) const {
  constexpr std::size_t kAhead = 3;
  if (i + 3 * kAhead < marked_.size()) {
    FetchBytes(&trees_.root(marked_[i + 3 * kAhead]), sizeof(MapRoot));
  }
  const auto for_each_child = [&](std::size_t k, const auto& fetch) {
    if (k >= marked_.size()) return;
    const NodeId* const child = trees_.children(marked_[k]);
    for (int slot = 0; slot < 8; ++slot) {
      if (child[slot] != kNoNode) fetch(child[slot]);
    }
  };
  for_each_child(i + 2 * kAhead, [&](NodeId child) { Prefetch(child); });
  for_each_child(i + kAhead, [&](NodeId child) {
    if (!VoxelTrees::IsLeaf(child)) return;
    const ClusterMoments* const window = trees_.FindWindow(trees_.leaf(child));
    if (window != nullptr) FetchBytes(window, sizeof(*window));
  });
}

void VoxelMap::RefreshTrees(std::size_t begin, std::size_t end, RefreshRoom* room,
                            std::vector<PlaneChange>* changes) {
  room->sums.clear();
  room->level.sums.clear();
  room->level.centres.clear();
  for (std::size_t i = begin; i < end; ++i) {
    PrefetchTrees(i);
    room->level.sums.push_back(room->sums.size());
    room->level.centres.push_back(trees_.CentreOf(marked_[i]));
    SumTree(marked_[i], &room->sums);
    trees_.root(marked_[i]).marked = 0;
    trees_.root(marked_[i]).refreshed = static_cast<std::uint32_t>(refreshes_);
  }
  // Below a planar node no query looks: its eigenvalues are saved.
  FindSurfaces(room);
  for (const TreeSum& sum : room->sums) {
    MapNode& n = trees_.node(sum.id);
    n.frames = SaturatingAdd(0, sum.frames);
    n.kind = sum.surface.kind;
    if ((n.kind == Surface::Kind::kPlane) == (n.plane != kNoNode)) {
      if (n.plane != kNoNode) trees_.plane(n) = sum.surface;
    } else {
      changes->push_back({sum.id, sum.surface});
    }
  }
}

void VoxelMap::Refresh() {
  if (marked_.empty()) return;
  ++refreshes_;
  constexpr std::size_t kChunk = 256, kTogether = 32;
  std::vector<std::vector<PlaneChange>> changes((marked_.size() + kChunk - 1) / kChunk);
  ParallelChunks(marked_.size(), kChunk, [&](std::size_t begin, std::size_t end) {
    RefreshRoom room;
    for (std::size_t i = begin; i < end; i += kTogether) {
      RefreshTrees(i, std::min(i + kTogether, end), &room, &changes[begin / kChunk]);
    }
  });
  for (const std::vector<PlaneChange>& of_chunk : changes) {
    for (const PlaneChange& change : of_chunk) {
      MapNode& n = trees_.node(change.node);
      trees_.FitPlane(&n);
      if (n.plane != kNoNode) trees_.plane(n) = change.surface;
    }
  }
  for (std::size_t i = 0; track_tiles_ && i < marked_.size(); ++i) {
    TouchTile(TileOf(trees_.root(marked_[i]).key), refreshes_);
  }
  marked_.clear();
}

}  // namespace lamina
