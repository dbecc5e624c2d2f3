#include "tools/metrics/map_quality.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/error.h"
#include "core/base/median.h"
#include "core/base/parallel.h"
#include "core/geometry/point_cluster.h"
#include "core/map/voxel_key.h"
#include "tools/results/posed_scans.h"

namespace lamina {
namespace {

constexpr double kMinEigenvalueM2 = 1e-8;
constexpr double kPlanarRatio = 1.0 / 16.0;
constexpr size_t kScansPerBatch = 16;

struct Voxel {
  VoxelKey key = 0;
  int frames = 0;
  PointCluster points;
};

// Clusters by voxel, in the order in which voxels came up.
class VoxelClusters {
 public:
  Voxel& At(VoxelKey key) {
    Voxel& voxel = index_.Gather(key, &voxels_);
    voxel.key = key;
    return voxel;
  }
  const std::vector<Voxel>& voxels() const { return voxels_; }

  size_t points_beyond_grid = 0;

 private:
  VoxelIndex index_;
  std::vector<Voxel> voxels_;
};

// What one voxel contributes to the means.
struct VoxelFigures {
  VoxelKey key;
  double entropy;
  double thickness_mm;
  bool planar;
};

VoxelClusters ClustersOfScan(const PreparedScan& scan, const PosedScan& posed,
                             double voxel_size_m) {
  const double inverse_size = 1.0 / voxel_size_m;
  const SweepDeskew deskew(posed.mean_twist);
  const Eigen::Matrix3d R = posed.T_world_lidar.R();
  VoxelClusters clusters;
  for (const TimedPoint& point : scan.points) {
    const Eigen::Vector3d p = R * deskew(point) + posed.T_world_lidar.t;
    if (!IsVoxelKeyInRange(p, inverse_size)) {
      ++clusters.points_beyond_grid;
      continue;
    }
    clusters.At(VoxelKeyOf(p, inverse_size)).points.AddPoint(p);
  }
  return clusters;
}

void MergeScan(const VoxelClusters& scan, VoxelClusters* map) {
  for (const Voxel& voxel : scan.voxels()) {
    Voxel& sum = map->At(voxel.key);
    ++sum.frames;
    sum.points += voxel.points;
  }
  map->points_beyond_grid += scan.points_beyond_grid;
}

// For each trajectory the posed scans that all trajectories have, the first pose made identity.
std::vector<std::vector<PosedScan>> CommonScans(const ScanSource& scans,
                                                const std::vector<NamedTrajectory>& trajectories,
                                                double tolerance_s) {
  std::vector<std::vector<PosedScan>> posed;
  std::vector<size_t> holders(scans.size(), 0);
  for (const NamedTrajectory& trajectory : trajectories) {
    posed.push_back(PoseScans(scans, trajectory.poses, tolerance_s));
    for (const PosedScan& p : posed.back()) ++holders[p.scan];
  }
  for (std::vector<PosedScan>& list : posed) {
    list.erase(std::remove_if(list.begin(), list.end(),
                              [&](const PosedScan& p) { return holders[p.scan] < posed.size(); }),
               list.end());
    if (list.empty()) continue;
    const SE3 T_first_world = list.front().T_world_lidar.Inverse();
    for (PosedScan& p : list) p.T_world_lidar = T_first_world * p.T_world_lidar;
  }
  return posed;
}

// The map of every trajectory. Each scan is read once, by one thread; merging keeps their order.
std::vector<VoxelClusters> BuildMaps(const ScanSource& scans,
                                     const std::vector<std::vector<PosedScan>>& posed,
                                     const MapQualityOptions& options) {
  ScanPreparationOptions preparation = options.preparation;
  preparation.min_range_m = options.min_range_m;
  preparation.max_range_m = options.max_range_m;
  const size_t count = posed.front().size();
  std::vector<VoxelClusters> maps(posed.size());
  for (size_t begin = 0; begin < count; begin += kScansPerBatch) {
    const size_t size = std::min(kScansPerBatch, count - begin);
    std::vector<std::vector<VoxelClusters>> batch(size);
    ParallelChunks(size, 1, [&](size_t k, size_t) {
      const size_t scan = posed.front()[begin + k].scan;
      const PreparedScan prepared = PrepareScan(
          scans.Read(scan), preparation, SweepPeriodOfScan(scans, scan, options.frame_period_s),
          scans.T_vehicle_lidar(scan));
      for (const std::vector<PosedScan>& list : posed) {
        batch[k].push_back(ClustersOfScan(prepared, list[begin + k], options.voxel_size_m));
      }
    });
    ParallelChunks(maps.size(), 1, [&](size_t m, size_t) {
      for (const auto& scan : batch) MergeScan(scan[m], &maps[m]);
    });
  }
  return maps;
}

// The voxels that count, in the order of their keys.
std::vector<VoxelFigures> FiguresOfVoxels(const VoxelClusters& map,
                                          const MapQualityOptions& options) {
  std::vector<VoxelFigures> figures;
  for (const Voxel& voxel : map.voxels()) {
    if (voxel.points.count < options.min_points || voxel.frames < options.min_frames) continue;
    const Eigen::Vector3d l = voxel.points.EigenPairs().l.cwiseMax(kMinEigenvalueM2);
    const double entropy = 0.5 * (3.0 * std::log(2.0 * M_PI * M_E) + l.array().log().sum());
    figures.push_back({voxel.key, entropy, 1e3 * std::sqrt(l(2)), l(2) / l(1) < kPlanarRatio});
  }
  std::sort(figures.begin(), figures.end(),
            [](const VoxelFigures& a, const VoxelFigures& b) { return a.key < b.key; });
  return figures;
}

double Mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value;
  return values.empty() ? std::numeric_limits<double>::quiet_NaN()
                        : sum / static_cast<double>(values.size());
}

struct CommonVoxel {
  VoxelKey key;
  bool planar;  // in at least one of the maps
};

std::vector<CommonVoxel> CommonVoxels(const std::vector<std::vector<VoxelFigures>>& maps) {
  std::vector<CommonVoxel> common;
  for (const VoxelFigures& voxel : maps.front()) common.push_back({voxel.key, voxel.planar});
  for (size_t m = 1; m < maps.size(); ++m) {
    std::vector<CommonVoxel> both;
    auto other = maps[m].begin();
    for (const CommonVoxel& voxel : common) {
      while (other != maps[m].end() && other->key < voxel.key) ++other;
      if (other == maps[m].end() || other->key != voxel.key) continue;
      both.push_back({voxel.key, voxel.planar || other->planar});
    }
    common = std::move(both);
  }
  return common;
}

MapQuality Summary(const std::vector<VoxelFigures>& voxels,
                   const std::vector<CommonVoxel>& common) {
  std::vector<double> entropy;
  std::vector<double> thickness;
  std::vector<double> common_entropy;
  std::vector<double> common_thickness;
  auto next = common.begin();
  for (const VoxelFigures& voxel : voxels) {
    entropy.push_back(voxel.entropy);
    if (voxel.planar) thickness.push_back(voxel.thickness_mm);
    if (next == common.end() || next->key != voxel.key) continue;
    common_entropy.push_back(voxel.entropy);
    if (next->planar) common_thickness.push_back(voxel.thickness_mm);
    ++next;
  }
  MapQuality quality;
  quality.voxels = entropy.size();
  quality.planar_voxels = thickness.size();
  quality.mme = Mean(entropy);
  quality.thickness_mean_mm = Mean(thickness);
  quality.thickness_median_mm = Median(thickness);
  quality.common_mme = Mean(common_entropy);
  quality.common_thickness_mm = Mean(common_thickness);
  return quality;
}

}  // namespace

void MapQualityOptions::Visit(OptionVisitor& v) {
  v.Number("voxel_size_m", &voxel_size_m, 0.01, 100.0);
  v.Number("min_range_m", &min_range_m, 0.0, 1000.0);
  v.Number("max_range_m", &max_range_m, 0.1, 10000.0);
  v.Integer("min_points", &min_points, 4, 1000000);
  v.Integer("min_frames", &min_frames, 1, 1000000);
  v.Number("stamp_tolerance_s", &stamp_tolerance_s, 0.0, 1e3);
  v.Number("frame_period_s", &frame_period_s, 1e-6, 1e3);
  v.Group("preparation", &preparation);
}

MapQualityReport MeasureMapQuality(const ScanSource& scans,
                                   const std::vector<NamedTrajectory>& trajectories,
                                   const MapQualityOptions& options) {
  CheckOptions(options, "map_quality");
  if (trajectories.empty()) throw std::logic_error("MeasureMapQuality: no trajectories given");
  const std::vector<std::vector<PosedScan>> posed =
      CommonScans(scans, trajectories, options.stamp_tolerance_s);
  const size_t count = posed.front().size();
  if (count < static_cast<size_t>(options.min_frames)) {
    throw InputError("map quality: only " + std::to_string(count) + " of " +
                     std::to_string(scans.size()) + " scans have a pose in each of the " +
                     std::to_string(trajectories.size()) + " trajectories, at least " +
                     std::to_string(options.min_frames) + " are needed; do the stamps agree?");
  }
  const std::vector<VoxelClusters> maps = BuildMaps(scans, posed, options);
  std::vector<std::vector<VoxelFigures>> figures(maps.size());
  ParallelChunks(maps.size(), 1,
                 [&](size_t m, size_t) { figures[m] = FiguresOfVoxels(maps[m], options); });
  const std::vector<CommonVoxel> common = CommonVoxels(figures);

  MapQualityReport report;
  report.scans = count;
  report.common_voxels = common.size();
  report.common_planar_voxels = static_cast<size_t>(
      std::count_if(common.begin(), common.end(), [](const CommonVoxel& v) { return v.planar; }));
  for (size_t m = 0; m < maps.size(); ++m) {
    report.trajectories.push_back(Summary(figures[m], common));
    report.trajectories.back().name = trajectories[m].name;
    report.trajectories.back().points_beyond_grid = maps[m].points_beyond_grid;
  }
  return report;
}

}  // namespace lamina
