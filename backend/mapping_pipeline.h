// The threads around the mapper: scans in, poses and map out.
//
//     read + prepare + cluster    parallel over the next scans
//       -> odometry, window, map  serial, in the order of the scans (Mapper)
//            -> bundle adjustment one window in flight, beside the next scans' odometry
//       -> observer               one call for each scan, in order
//
// Bounded: at most `lookahead_scans` are between the first stage and the last, so back-pressure
// reaches the reader. A window's correction takes effect a fixed number of frames after it was
// started, never "when it is ready". Therefore the result is the same, bit for bit, at any number
// of threads.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "backend/mapper.h"
#include "backend/scan_decoder.h"
#include "core/options.h"
#include "io/scan_source.h"

namespace lamina {

struct MappingOptions {
  ScanPreparationOptions preparation;
  MapperOptions mapper;
  PipelineOptions pipeline;
};

struct ScanReport : ScanDecodeReport {
  OdometryFrame odometry;
  bool keyframe = false;
  // Milliseconds of wall time, of the solve: the one that was taken in before this scan.
  double odometry_ms = 0, map_ms = 0, solve_ms = 0;
};

struct MappingResult {
  // One pose for each scan of the range that was reached, final; skipped scans get one between
  // their neighbours'.
  Trajectory all_scans;
  // Without the skipped ones.
  Trajectory frames;
  std::size_t keyframes = 0, lost = 0, restarts = 0, degenerate = 0, searched = 0;
  std::map<SkipReason, std::size_t> skipped;
  std::size_t solves = 0, failed_solves = 0;
  bool interrupted = false;
};

struct MappingCallbacks {
  // Called after each scan, in order, from one thread at a time.
  std::function<void(const ScanReport&)> on_scan;
};

// Not thread-safe: one Run at a time.
class MappingPipeline {
 public:
  // `on_evicted` gets the planes of parts of the map that leave memory; may be empty. Throws
  // OptionError.
  explicit MappingPipeline(const MappingOptions& options,
                           std::function<void(const Surfel&)> on_evicted = nullptr);

  // Maps scans [begin, end) of the source. Once `stop` is true, scans that have been read are still
  // processed, and the run ends in good order.
  MappingResult Run(const ScanSource& source, std::size_t begin, std::size_t end,
                    const MappingCallbacks& callbacks, const std::atomic<bool>* stop = nullptr);

  const VoxelMap& map() const { return mapper_.map(); }

 private:
  MappingOptions options_;
  Mapper mapper_;
};

}  // namespace lamina
