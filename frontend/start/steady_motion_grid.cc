#include "frontend/start/steady_motion_grid.h"

#include <algorithm>
#include <cmath>

#include "core/base/processor.h"
#include "core/map/voxel_key.h"

namespace lamina {
namespace {

// Fewer points are no voxel.
constexpr float kLeastPoints = 5.0F;
// How thick these are taken to be where they are to tell nothing: half way, by the logarithm,
// between what is sharp and 1 m.
constexpr double kUnknownM = 0.12;

// Smallest eigenvalue of a covariance of the plan.
double LeastVariance(double xx, double xy, double yy) {
  const double half = 0.5 * (xx - yy);
  return 0.5 * (xx + yy) - std::sqrt(half * half + xy * xy);
}

// Smallest eigenvalue of a covariance: the first root of its characteristic polynomial, which is
// concave up to there, so that Newton's steps from zero do not pass it. Steps that are none to
// speak of beside `scale` end it.
double LeastVariance(double xx, double xy, double yy, double xz, double yz, double zz,
                     double scale) {
  constexpr int kMostSteps = 50;
  constexpr double kTolerance = 1e-6;
  const double minor = yy * zz - yz * yz;
  const double trace = xx + yy + zz;
  const double minors = minor + xx * (yy + zz) - xy * xy - xz * xz;
  const double determinant = xx * minor - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
  double root = 0.0;
  for (int i = 0; i < kMostSteps; ++i) {
    const double value = ((root - trace) * root + minors) * root - determinant;
    const double slope = (3.0 * root - 2.0 * trace) * root + minors;
    if (value >= 0.0 || slope <= 0.0) break;
    const double step = -value / slope;
    root += step;
    if (step < kTolerance * scale) break;
  }
  return root;
}

}  // namespace

SteadyMotionGrid::SteadyMotionGrid(double voxel_size_m, double noise_m,
                                   const SteadyMotionAxes& axes,
                                   const std::vector<SteadyScan>& scans,
                                   const std::vector<char>& is_in_space,
                                   const Eigen::Vector3d& shift)
    : voxel_size_m_(static_cast<float>(voxel_size_m)),
      inverse_size_(static_cast<float>(1.0 / voxel_size_m)),
      noise2_(noise_m * noise_m) {
  Eigen::Matrix3d frame;
  frame << axes.along.transpose(), axes.across.transpose(), axes.up.transpose();
  struct Place {
    VoxelKey column;
    std::int32_t cluster, scan;
    std::size_t in_scan;
    Eigen::Vector3d p;
  };
  std::vector<Place> places;
  for (std::size_t k = 0; k < scans.size(); ++k) {
    for (std::size_t i = 0; i < scans[k].clusters.size(); ++i) {
      const Eigen::Vector3d p = frame * scans[k].clusters[i].mean + voxel_size_m * shift;
      const bool in_space = is_in_space[places.size()] != 0;
      const VoxelKey column =
          VoxelKeyOf({in_space ? voxel_size_m : 0.0, p.y(), p.z()}, 1.0 / voxel_size_m);
      places.push_back(
          {column, static_cast<std::int32_t>(places.size()), static_cast<std::int32_t>(k), i, p});
    }
  }
  std::stable_sort(places.begin(), places.end(),
                   [](const Place& a, const Place& b) { return a.column < b.column; });
  members_.reserve(places.size());
  heights_.reserve(places.size());
  for (const Place& place : places) {
    const SteadyScan& scan = scans[static_cast<std::size_t>(place.scan)];
    const std::size_t at = members_.size();
    if (at == 0 || place.column != places[at - 1].column)
      columns_.push_back({at, at, is_in_space[static_cast<std::size_t>(place.cluster)] != 0});
    columns_.back().end = at + 1;
    const Eigen::Vector3d middle = VoxelCentre(place.column, voxel_size_m);
    const PointCluster& cluster = scan.clusters[place.in_scan];
    const Eigen::Matrix3f c =
        (frame * cluster.Covariance().Dense() * frame.transpose()).cast<float>();
    const auto n = static_cast<float>(cluster.count);
    const auto y = static_cast<float>(place.p.y() - middle.y());
    const auto z = static_cast<float>(place.p.z() - middle.z());
    members_.push_back({n, n * y, n * c(0, 0), n * c(0, 1), n * (c(1, 1) + y * y), place.cluster});
    heights_.push_back({n * z, n * c(0, 2), n * (c(1, 2) + y * z), n * (c(2, 2) + z * z)});
    x_m_.push_back(static_cast<float>(place.p.x()));
    time_s_.push_back(scan.cluster_times_s.empty()
                          ? 0.0F
                          : static_cast<float>(scan.cluster_times_s[place.in_scan]));
    scan_.push_back(place.scan);
  }
}

LAMINA_FOR_EACH_PROCESSOR
void SteadyMotionGrid::FindAlong(const WayAlong& way, Scratch* scratch) const {
  const std::size_t count = members_.size();
  const std::vector<float> way_m(way.positions_m.begin(), way.positions_m.end());
  const std::vector<float> speed_m_s(way.speeds_m_s.begin(), way.speeds_m_s.end());
  scratch->x_m.resize(count);
  scratch->along.resize(count);
  float* const x_m = scratch->x_m.data();
  std::int32_t* const along = scratch->along.data();
  for (std::size_t i = 0; i < count; ++i) {
    const auto k = static_cast<std::size_t>(scan_[i]);
    const float x = x_m_[i] + (way_m[k] + speed_m_s[k] * time_s_[i]);
    const float voxel = std::floor(x * inverse_size_);
    along[i] = static_cast<std::int32_t>(voxel);
    x_m[i] = x - (voxel + 0.5F) * voxel_size_m_;
  }
}

LAMINA_FOR_EACH_PROCESSOR
void SteadyMotionGrid::SumVoxels(const Column& column, Scratch* scratch) const {
  std::int32_t* const along = scratch->along.data();
  std::int32_t first = along[column.begin], last = first;
  for (std::size_t i = column.begin; i < column.end; ++i) {
    first = std::min(first, along[i]);
    last = std::max(last, along[i]);
  }
  const auto numbers = static_cast<std::size_t>(last - first) + 1;
  if (scratch->voxel_at.size() < numbers) scratch->voxel_at.resize(numbers, kNone);
  scratch->voxels.clear();
  scratch->numbers.clear();
  for (std::size_t i = column.begin; i < column.end; ++i) {
    std::int32_t& at = scratch->voxel_at[static_cast<std::size_t>(along[i] - first)];
    if (at == kNone) {
      at = static_cast<std::int32_t>(scratch->voxels.size());
      scratch->voxels.emplace_back().first_scan = scan_[i];
      scratch->numbers.push_back(along[i] - first);
    }
    along[i] = at;
    Voxel& voxel = scratch->voxels[static_cast<std::size_t>(at)];
    voxel.others |= voxel.first_scan ^ scan_[i];
    const Member& m = members_[i];
    const float x = scratch->x_m[i], nx = m.n * x;
    voxel.n += m.n;
    voxel.x += nx;
    voxel.y += m.y;
    voxel.xx += m.xx + nx * x;
    voxel.xy += m.xy + m.y * x;
    voxel.yy += m.yy;
  }
  for (const std::int32_t number : scratch->numbers)
    scratch->voxel_at[static_cast<std::size_t>(number)] = kNone;
  if (column.in_space) AddHeights(column, scratch);
}

void SteadyMotionGrid::AddHeights(const Column& column, Scratch* scratch) const {
  scratch->heights.assign(scratch->voxels.size(), Height());
  for (std::size_t i = column.begin; i < column.end; ++i) {
    Height& sums = scratch->heights[static_cast<std::size_t>(scratch->along[i])];
    const Height& m = heights_[i];
    sums.z += m.z;
    sums.xz += m.xz + m.z * scratch->x_m[i];
    sums.yz += m.yz;
    sums.zz += m.zz;
  }
}

float SteadyMotionGrid::SharpnessOf(const Voxel& voxel, const Height* height) const {
  const double per_point = 1.0 / static_cast<double>(voxel.n);
  const double x = per_point * voxel.x, y = per_point * voxel.y;
  const double xx = per_point * voxel.xx - x * x, xy = per_point * voxel.xy - x * y,
               yy = per_point * voxel.yy - y * y;
  double variance = 0.0;
  if (height == nullptr) {
    variance = LeastVariance(xx, xy, yy);
  } else {
    const double z = per_point * height->z;
    variance =
        LeastVariance(xx, xy, yy, per_point * height->xz - x * z, per_point * height->yz - y * z,
                      per_point * height->zz - z * z, noise2_);
  }
  return -0.5F * std::log(static_cast<float>(std::max(0.0, variance) + noise2_));
}

void SteadyMotionGrid::AddSharpness(const WayAlong& way, const std::vector<std::int32_t>& block_of,
                                    Sparse few, Scratch* scratch, Evidence* sums) const {
  const auto sparse = static_cast<float>(
      few == Sparse::kBlurred ? 0.0 : -0.5 * std::log(kUnknownM * kUnknownM + noise2_));
  FindAlong(way, scratch);
  for (const Column& column : columns_) {
    SumVoxels(column, scratch);
    scratch->sharpness.clear();
    for (std::size_t v = 0; v < scratch->voxels.size(); ++v) {
      const Voxel& voxel = scratch->voxels[v];
      const bool is_sparse = voxel.n < kLeastPoints;
      if (voxel.others != 0) sums->shared += voxel.n;
      if (is_sparse) sums->sparse += voxel.n;
      scratch->sharpness.push_back(
          is_sparse ? sparse
                    : SharpnessOf(voxel, column.in_space ? &scratch->heights[v] : nullptr));
    }
    for (std::size_t i = column.begin; i < column.end; ++i) {
      const Member& m = members_[i];
      const auto block = static_cast<std::size_t>(block_of[static_cast<std::size_t>(m.cluster)]);
      sums->blocks[block] += m.n * scratch->sharpness[static_cast<std::size_t>(scratch->along[i])];
    }
  }
}

}  // namespace lamina
