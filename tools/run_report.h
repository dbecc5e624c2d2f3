// What a run tells about itself: frames.csv while it goes on, summary.json at its end.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "backend/mapping_pipeline.h"
#include "core/trajectory_metrics.h"
#include "io/file_writer.h"
#include "io/session_database.h"

namespace lamina {

// A line for each scan, in order. Distances in metres, angles in radians, covariance of the pose's
// tangent [rotation; translation] (core/se3.h). Throws OutputError. Not thread-safe.
class FrameTable {
 public:
  explicit FrameTable(const std::string& path);
  void Append(const SessionScan& scan);
  void Commit() { writer_.Commit(); }

 private:
  FileWriter writer_;
};

// CPU seconds of this process so far, all threads.
double ProcessCpuSeconds();

// Largest resident set of this process so far.
std::size_t PeakRssBytes();

// Resident set of this process now; 0 if the system does not tell.
std::size_t ResidentBytes();

struct RunFigures {
  double wall_s = 0.0, cpu_s = 0.0;
  std::size_t map_surfels = 0;
  std::size_t map_peak_bytes = 0;
  bool map_over_budget = false;  // at any time
  bool interrupted = false;
};

// Tells where the files of a run or a session lie.
void PrintOutputs(const std::string& folder);

// Writes the surfaces that at least min_frames frames have seen; returns their number.
std::size_t WriteMap(const std::string& path, const VoxelMap& map, int min_frames);

// `errors` is null without a true trajectory.
nlohmann::json Summarise(const MappingCounts& counts, const VoxelMap& map,
                         const RunFigures& figures, const TrajectoryErrors* errors);

}  // namespace lamina
