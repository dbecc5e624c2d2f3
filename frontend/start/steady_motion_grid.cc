#include "frontend/start/steady_motion_grid.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "core/base/processor.h"
#include "core/map/voxel_key.h"

namespace lamina {
namespace {

// Voxels of fewer points are sparse.
constexpr float kLeastPoints = 5.0F;
// Thickness of sparse voxels under Sparse::kTellNothing: half way, by the logarithm, between what
// is sharp and 1 m.
constexpr double kUnknownM = 0.12;

// Positions of members along u under one way: `x_m` if the sensor stood still, and `time_s` within
// their scan.
struct MovedMembers {
  const float *x_m, *time_s;
  const std::int32_t* scan;
  std::size_t count;
};

// Finds the number of each member's voxel along u, and its offset from the middle of that. Outputs
// do not alias inputs, which lets the compiler take eight members at once.
LAMINA_FOR_EACH_PROCESSOR
void FindVoxels(const MovedMembers& of, const float* __restrict way_m,
                const float* __restrict speed_m_s, float voxel_size_m, float inverse_size,
                std::int32_t* __restrict along, float* __restrict from_middle_m) {
  for (std::size_t i = 0; i < of.count; ++i) {
    const float x = of.x_m[i] + (way_m[of.scan[i]] + speed_m_s[of.scan[i]] * of.time_s[i]);
    const float voxel = std::floor(x * inverse_size);
    along[i] = static_cast<std::int32_t>(voxel);
    from_middle_m[i] = x - (voxel + 0.5F) * voxel_size_m;
  }
}

using EightFloats = float __attribute__((vector_size(32)));
using EightInts = std::int32_t __attribute__((vector_size(32)));

// The sums of a member, x from the middle of its voxel, about that.
[[gnu::always_inline]] inline void MoveAlong(const VoxelPlan& member, float x, EightFloats* sums) {
  std::memcpy(sums, &member, sizeof(*sums));
  // n x belongs to x, n x^2 to xx and y x to xy.
  const EightFloats moved = __builtin_shuffle(*sums, EightInts{6, 0, 6, 0, 2, 6, 6, 6});
  *sums += moved * EightFloats{1.0F, 1.0F, 1.0F, x, 1.0F, 1.0F, 1.0F, 1.0F} * x;
}

template <typename T>
void Grow(std::size_t size, std::vector<T>* values) {
  if (values->size() < size) values->resize(size);
}

}  // namespace

std::vector<SteadyMotionGrid::TurnedCluster> SteadyMotionGrid::Turn(
    const SteadyMotionAxes& axes, const std::vector<SteadyScan>& scans) {
  Eigen::Matrix3d frame;
  frame << axes.along.transpose(), axes.across.transpose(), axes.up.transpose();
  std::vector<TurnedCluster> turned;
  for (std::size_t k = 0; k < scans.size(); ++k) {
    const SteadyScan& scan = scans[k];
    for (std::size_t i = 0; i < scan.clusters.size(); ++i) {
      const PointCluster& cluster = scan.clusters[i];
      TurnedCluster& to = turned.emplace_back();
      to.mean = frame * cluster.mean;
      to.covariance = (frame * cluster.Covariance().Dense() * frame.transpose()).cast<float>();
      to.points = static_cast<float>(cluster.count);
      if (!scan.cluster_times_s.empty()) to.time_s = static_cast<float>(scan.cluster_times_s[i]);
      to.scan = static_cast<std::int32_t>(k);
    }
  }
  return turned;
}

SteadyMotionGrid::SteadyMotionGrid(double voxel_size_m, double noise_m,
                                   const std::vector<TurnedCluster>& clusters,
                                   const std::vector<char>& is_in_space,
                                   const Eigen::Vector3d& shift)
    : voxel_size_m_(static_cast<float>(voxel_size_m)),
      inverse_size_(static_cast<float>(1.0 / voxel_size_m)),
      noise2_(noise_m * noise_m) {
  std::vector<std::pair<VoxelKey, std::int32_t>> places;  // column, cluster in it
  places.reserve(clusters.size());
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    const Eigen::Vector3d p = clusters[i].mean + voxel_size_m * shift;
    const Eigen::Vector3d across(is_in_space[i] != 0 ? voxel_size_m : 0.0, p.y(), p.z());
    places.emplace_back(VoxelKeyOf(across, 1.0 / voxel_size_m), static_cast<std::int32_t>(i));
  }
  std::sort(places.begin(), places.end());
  std::vector<std::int32_t> of;
  std::vector<std::size_t> begins;  // of the columns, and the end
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (i == 0 || places[i].first != places[i - 1].first) begins.push_back(i);
    of.push_back(places[i].second);
  }
  const std::size_t columns = begins.size();
  begins.push_back(places.size());
  // One column in kEvery belongs to Share::kFew; these come first.
  constexpr std::size_t kEvery = 4;
  const auto add = [&](std::size_t c) {
    const std::size_t at = begins[c];
    const bool in_space = is_in_space[static_cast<std::size_t>(of[at])] != 0;
    columns_.push_back({members_.size(), members_.size() + begins[c + 1] - at, in_space});
    AddMembers(clusters, of.data() + at, begins[c + 1] - at,
               VoxelCentre(places[at].first, voxel_size_m), voxel_size_m * shift);
  };
  for (std::size_t c = 0; c < columns; c += kEvery) add(c);
  const std::size_t few = columns_.size();
  for (std::size_t c = 0; c < columns; ++c) {
    if (c % kEvery != 0) add(c);
  }
  MakeBatches(few);
}

void SteadyMotionGrid::AddMembers(const std::vector<TurnedCluster>& clusters,
                                  const std::int32_t* of, std::size_t count,
                                  const Eigen::Vector3d& middle, const Eigen::Vector3d& shift_m) {
  for (std::size_t i = 0; i < count; ++i) {
    const TurnedCluster& cluster = clusters[static_cast<std::size_t>(of[i])];
    const Eigen::Vector3d p = cluster.mean + shift_m;
    const Eigen::Matrix3f& c = cluster.covariance;
    const float n = cluster.points;
    const auto y = static_cast<float>(p.y() - middle.y());
    const auto z = static_cast<float>(p.z() - middle.z());
    members_.push_back({n, 0.0F, n * y, n * c(0, 0), n * c(0, 1), n * (c(1, 1) + y * y)});
    cluster_.push_back(of[i]);
    heights_.push_back({n * z, n * c(0, 2), n * (c(1, 2) + y * z), n * (c(2, 2) + z * z)});
    x_m_.push_back(static_cast<float>(p.x()));
    time_s_.push_back(cluster.time_s);
    scan_.push_back(cluster.scan);
  }
}

void SteadyMotionGrid::MakeBatches(std::size_t few) {
  // The sums of so many members stay in the nearest cache.
  constexpr std::size_t kMostMembers = 512;
  std::size_t members = 0;
  for (std::size_t c = 0; c < columns_.size(); ++c) {
    const Column& column = columns_[c];
    members += column.end - column.begin;
    if (c == few) few_batches_ = batches_.size();
    if (c == 0 || c == few || members > kMostMembers ||
        column.in_space != columns_[c - 1].in_space) {
      batches_.push_back({c, c});
      members = column.end - column.begin;
    }
    batches_.back().end = c + 1;
  }
  if (few == columns_.size()) few_batches_ = batches_.size();
}

SteadyMotionGrid::Batch SteadyMotionGrid::BatchesOf(Share share) const {
  return {share == Share::kOthers ? few_batches_ : 0,
          share == Share::kFew ? few_batches_ : batches_.size()};
}

std::vector<std::int32_t> SteadyMotionGrid::InOrder(
    const std::vector<std::int32_t>& of_clusters) const {
  std::vector<std::int32_t> of_members;
  of_members.reserve(cluster_.size());
  for (const std::int32_t cluster : cluster_)
    of_members.push_back(of_clusters[static_cast<std::size_t>(cluster)]);
  return of_members;
}

std::vector<double> SteadyMotionGrid::PointsOf(Share share, const std::vector<std::int32_t>& blocks,
                                               std::size_t count) const {
  std::vector<double> points(count, 0.0);
  const Batch all = BatchesOf(share);
  if (all.begin == all.end) return points;
  for (std::size_t i = Begin(batches_[all.begin]); i < End(batches_[all.end - 1]); ++i)
    points[static_cast<std::size_t>(blocks[i])] += static_cast<double>(members_[i].n);
  return points;
}

LAMINA_FOR_EACH_PROCESSOR
std::size_t SteadyMotionGrid::FindAlong(const WayAlong& way, std::size_t begin, std::size_t end,
                                        Scratch* scratch) const {
  const std::size_t count = end - begin;
  const std::vector<float> ways_m(way.positions_m.begin(), way.positions_m.end());
  const std::vector<float> speeds_m_s(way.speeds_m_s.begin(), way.speeds_m_s.end());
  scratch->x_m.resize(members_.size());
  scratch->along.resize(members_.size());
  std::int32_t* const along = scratch->along.data() + begin;
  FindVoxels({x_m_.data() + begin, time_s_.data() + begin, scan_.data() + begin, count},
             ways_m.data(), speeds_m_s.data(), voxel_size_m_, inverse_size_, along,
             scratch->x_m.data() + begin);
  std::int32_t first = std::numeric_limits<std::int32_t>::max();
  std::int32_t last = std::numeric_limits<std::int32_t>::min();
  for (std::size_t i = 0; i < count; ++i) {
    first = std::min(first, along[i]);
    last = std::max(last, along[i]);
  }
  for (std::size_t i = 0; i < count; ++i) along[i] -= first;
  return count == 0 ? 0 : static_cast<std::size_t>(last - first) + 1;
}

LAMINA_FOR_EACH_PROCESSOR
std::size_t SteadyMotionGrid::SumVoxels(const Batch& batch, std::int32_t before,
                                        Scratch* scratch) const {
  Grow(End(batch) - Begin(batch), &scratch->plans);
  Grow(End(batch) - Begin(batch), &scratch->scans);
  std::int32_t* const along = scratch->along.data();
  std::int32_t* const place_at = scratch->place_at.data();
  VoxelPlan* const plans = scratch->plans.data();
  VoxelScans* const scans = scratch->scans.data();
  const float* const x_m = scratch->x_m.data();
  const VoxelPlan* const members = members_.data();
  const std::int32_t* const scan = scan_.data();
  std::int32_t next = before;
  for (std::size_t c = batch.begin; c < batch.end; ++c) {
    const std::int32_t first = next;  // places before it are of other columns
    const std::size_t end = columns_[c].end;
    for (std::size_t i = columns_[c].begin; i < end; ++i) {
      EightFloats sums, so_far;
      MoveAlong(members[i], x_m[i], &sums);
      std::int32_t& place = place_at[along[i]];
      const bool is_new = place < first;
      if (is_new) place = next++;
      along[i] = place - before;
      VoxelPlan& voxel = plans[along[i]];
      VoxelScans& seen = scans[along[i]];
      if (is_new) {
        std::memcpy(static_cast<void*>(&voxel), &sums, sizeof(sums));
        seen = {scan[i], 0};
        continue;
      }
      std::memcpy(&so_far, &voxel, sizeof(so_far));
      so_far += sums;
      std::memcpy(static_cast<void*>(&voxel), &so_far, sizeof(so_far));
      seen.others |= seen.first ^ scan[i];
    }
  }
  return static_cast<std::size_t>(next - before);
}

void SteadyMotionGrid::AddHeights(const Batch& batch, std::size_t voxels, Scratch* scratch) const {
  scratch->heights.assign(voxels, VoxelHeights());
  VoxelHeights* const heights = scratch->heights.data();
  const VoxelHeights* const members = heights_.data();
  const std::int32_t* const along = scratch->along.data();
  const float* const x_m = scratch->x_m.data();
  const std::size_t end = End(batch);
  for (std::size_t i = Begin(batch); i < end; ++i) {
    FourFloats sums, so_far;
    std::memcpy(&sums, &members[i], sizeof(sums));
    sums += FourFloats{0.0F, members[i].z * x_m[i], 0.0F, 0.0F};
    std::memcpy(&so_far, &heights[along[i]], sizeof(so_far));
    so_far += sums;
    std::memcpy(static_cast<void*>(&heights[along[i]]), &so_far, sizeof(so_far));
  }
}

void SteadyMotionGrid::Sharpen(std::size_t voxels, bool in_space, float sparse, Scratch* scratch,
                               Evidence* sums) const {
  Grow(voxels, &scratch->sharpness);
  Grow(voxels, &scratch->dense);
  const VoxelPlan* const plans = scratch->plans.data();
  const VoxelScans* const scans = scratch->scans.data();
  float* const sharpness = scratch->sharpness.data();
  std::int32_t* const places = scratch->dense.data();
  std::size_t dense = 0;
  float shared = 0.0F;
  // Free of branches, since sparse voxels cannot be predicted.
  for (std::size_t v = 0; v < voxels; ++v) {
    sharpness[v] = sparse;
    places[dense] = static_cast<std::int32_t>(v);
    dense += static_cast<std::size_t>(plans[v].n >= kLeastPoints);
    shared += plans[v].n * static_cast<float>(scans[v].others != 0);
  }
  sums->shared += shared;
  FindSharpness(plans, in_space ? scratch->heights.data() : nullptr, places, dense, noise2_,
                sharpness);
}

void SteadyMotionGrid::AddSharpness(const WayAlong& way, const std::vector<std::int32_t>& blocks,
                                    Sparse few, Share share, Scratch* scratch,
                                    Evidence* sums) const {
  const Batch all = BatchesOf(share);
  if (all.begin == all.end) return;

  const auto sparse = static_cast<float>(
      few == Sparse::kBlurred ? 0.0 : -0.5 * std::log(kUnknownM * kUnknownM + noise2_));
  scratch->place_at.assign(
      FindAlong(way, Begin(batches_[all.begin]), End(batches_[all.end - 1]), scratch), -1);
  const VoxelPlan* const members = members_.data();
  const std::int32_t* const block = blocks.data();
  double* const of_blocks = sums->blocks.data();
  std::int32_t before = 0;
  for (std::size_t b = all.begin; b < all.end; ++b) {
    const Batch& batch = batches_[b];
    const std::size_t voxels = SumVoxels(batch, before, scratch);
    before += static_cast<std::int32_t>(voxels);
    if (InSpace(batch)) AddHeights(batch, voxels, scratch);
    Sharpen(voxels, InSpace(batch), sparse, scratch, sums);
    const float* const sharpness = scratch->sharpness.data();
    const std::int32_t* const along = scratch->along.data();
    const std::size_t end = End(batch);
    for (std::size_t i = Begin(batch); i < end; ++i)
      of_blocks[block[i]] += members[i].n * sharpness[along[i]];
  }
}

double SteadyMotionGrid::SparsePoints(const WayAlong& way, Scratch* scratch) const {
  scratch->place_at.assign(FindAlong(way, 0, members_.size(), scratch), -1);
  double points = 0.0;
  std::int32_t before = 0;
  for (const Batch& batch : batches_) {
    const std::size_t voxels = SumVoxels(batch, before, scratch);
    before += static_cast<std::int32_t>(voxels);
    for (std::size_t v = 0; v < voxels; ++v) {
      const float n = scratch->plans[v].n;
      points += n < kLeastPoints ? static_cast<double>(n) : 0.0;
    }
  }
  return points;
}

}  // namespace lamina
