// How crisp the map is that a trajectory builds from its scans: quality without ground truth.
//
// The points of all scans, each deskewed by the trajectory's own motion
// (tools/results/posed_scans.h) and brought to the world by its pose, are gathered in cubic voxels.
// A voxel counts if it holds at least `min_points` points of at least `min_frames` scans. With
// Sigma the covariance (divided by N) of its points and l1 >= l2 >= l3 > 0 its eigenvalues (never
// taken below (0.1 mm)^2):
//
//   MME        mean over voxels of 1/2 ln det(2 pi e Sigma), the mean map entropy (Droeschel and
//              Behnke, ICRA 2014); lower is crisper (halving the spread in one direction: -0.69)
//   thickness  sqrt(l3), over the planar voxels, those with l3 / l2 < 1/16; millimetres
//   common     the same over one set of voxels for all trajectories of a call: those that count for
//              every one of them, and for the thickness are planar in at least one. Without it a
//              blurred map wins by losing its bad voxels. Compare trajectories by these figures.
//
// So that grids agree, each trajectory is moved to make its first common pose the identity, and
// only scans that have a pose in every trajectory are used. The figures are of use for comparing
// trajectories of one recording; other recordings have other surfaces.
//
// Memory: about 130 bytes per voxel and trajectory, and, for each thread, one scan and its voxels
// (16 scans' voxels are held before they are merged); no points are kept. The result does not
// depend on the number of threads.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "core/options/options.h"
#include "frontend/scan/scan_preparation.h"
#include "io/recording/scan_source.h"

namespace lamina {

struct MapQualityOptions {
  double voxel_size_m = 1.0;
  double min_range_m = 5.0;
  double max_range_m = 100.0;
  int min_points = 20;
  int min_frames = 3;
  // A pose belongs to a scan if their stamps differ by no more.
  double stamp_tolerance_s = 0.01;
  // The sweep's duration where neither `preparation` nor the stamps tell it.
  double frame_period_s = 0.1;
  // Deskewing and vertical correction are taken from here, the range limits are those above.
  ScanPreparationOptions preparation;

  void Visit(OptionVisitor& v);
};

struct NamedTrajectory {
  std::string name;
  Trajectory poses;  // stamped as the scans are
};

struct MapQuality {
  std::string name;
  std::size_t voxels = 0;  // that count
  std::size_t planar_voxels = 0;
  // NaN where there are no voxels to average.
  double mme = 0.0;
  double thickness_mean_mm = 0.0;
  double thickness_median_mm = 0.0;
  double common_mme = 0.0;
  double common_thickness_mm = 0.0;
  // Points more than 2^20 voxels from the start, left out: a trajectory that has flown apart.
  std::size_t points_beyond_grid = 0;
};

struct MapQualityReport {
  std::size_t scans = 0;  // used: those with a pose in every trajectory
  std::size_t common_voxels = 0;
  std::size_t common_planar_voxels = 0;
  std::vector<MapQuality> trajectories;  // in the order given
};

// Throws InputError if fewer than `min_frames` scans have a pose in every trajectory or a scan
// cannot be read, OptionError for options outside of their rules.
MapQualityReport MeasureMapQuality(const ScanSource& scans,
                                   const std::vector<NamedTrajectory>& trajectories,
                                   const MapQualityOptions& options);

}  // namespace lamina
