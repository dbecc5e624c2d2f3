// The full point map of a finished run: all points of all posed scans, deskewed by the trajectory's
// own motion, in the world frame, thinned to one point per voxel.
#pragma once

#include <atomic>
#include <cstddef>
#include <vector>

#include "core/options/options.h"
#include "frontend/scan/scan_preparation.h"
#include "io/map/map_io.h"
#include "io/recording/scan_source.h"
#include "tools/results/posed_scans.h"

namespace lamina {

struct ExportOptions {
  double resolution_m = 0.1;
  // Bound on the set of voxels taken. A map with more voxels is made in several passes over the
  // scans (tools/export/thinning.h). Beside it stand one scan and its points for each thread.
  int budget_mb = 512;
  // The sweep's duration where neither `preparation` nor the stamps tell it.
  double frame_period_s = 0.1;
  ScanPreparationOptions preparation;

  void Visit(OptionVisitor& v);
};

struct ExportResult {
  std::size_t points = 0;  // written
  int passes = 0;
  std::size_t points_beyond_grid = 0;  // more than 2^20 voxels from the origin: left out
  bool interrupted = false;            // not all points are written
};

// Writes the points, with the intensity of their scan, in an order that depends on the scans and
// the options alone; the set of points not even on the budget. The caller commits the writer. Ends
// early once `stop` is true.
// Throws InputError if a scan cannot be read, OptionError, OutputError.
ExportResult ExportCloud(const ScanSource& scans, const std::vector<PosedScan>& posed,
                         const ExportOptions& options, CloudWriter* writer,
                         const std::atomic<bool>* stop = nullptr);

}  // namespace lamina
