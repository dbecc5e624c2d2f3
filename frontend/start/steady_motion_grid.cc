#include "frontend/start/steady_motion_grid.h"

#include "core/base/processor.h"

namespace lamina {

void SteadyMotionGrid::Begin(std::size_t clusters) {
  if (index.expected_size() < clusters / 4) {
    index = VoxelIndex(clusters / 4);
  } else {
    index.Clear();
  }
  voxels.clear();
  first_scan.clear();
  shared.clear();
  in_space.clear();
  voxel_of.clear();
  voxels.reserve(clusters / 4);
  voxel_of.reserve(clusters);
}

LAMINA_FOR_EACH_PROCESSOR
void SteadyMotionGrid::FindVoxels(const SteadyScan& scan, const char* is_in_space,
                                  const Eigen::Vector3d& u, double way_m, double speed_m_s,
                                  const Eigen::Vector3d& shift_m, double inverse_size) {
  constexpr double kApartM = 10000.0;  // farther than anything is seen
  const Eigen::Vector3d space_shift_m = shift_m - Eigen::Vector3d::Constant(kApartM);
  const std::size_t count = scan.clusters.size();
  means_.resize(count);
  keys_.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double during_m =
        scan.cluster_times_s.empty() ? 0.0 : speed_m_s * scan.cluster_times_s[i];
    means_[i] = scan.clusters[i].mean + (way_m + during_m) * u;
    keys_[i] =
        VoxelKeyOf(means_[i] + (is_in_space[i] != 0 ? space_shift_m : shift_m), inverse_size);
  }
  auto next = static_cast<std::int32_t>(voxels.size());
  for (std::size_t i = 0; i < count; ++i) {
    if (i + kAhead < count) index.Prefetch(keys_[i + kAhead]);
    const std::int32_t voxel = index.FindOrInsert(keys_[i], next);
    if (voxel == next) ++next;
    voxel_of.push_back(voxel);
  }
  voxels.resize(static_cast<std::size_t>(next));
}

LAMINA_FOR_EACH_PROCESSOR
void SteadyMotionGrid::AddScan(const SteadyScan& scan, const char* is_in_space,
                               std::size_t number) {
  first_scan.resize(voxels.size(), number);
  shared.resize(voxels.size(), 0);
  in_space.resize(voxels.size(), 0);
  const std::size_t count = scan.clusters.size();
  const std::int32_t* const of = voxel_of.data() + (voxel_of.size() - count);
  for (std::size_t i = 0; i < count; ++i) {
    if (i + kAhead < count) __builtin_prefetch(&voxels[static_cast<std::size_t>(of[i + kAhead])]);
    const auto voxel = static_cast<std::size_t>(of[i]);
    PointCluster moved = scan.clusters[i];
    moved.mean = means_[i];
    voxels[voxel] += moved;
    if (first_scan[voxel] != number) shared[voxel] = 1;
    in_space[voxel] = is_in_space[i];
  }
}

}  // namespace lamina
