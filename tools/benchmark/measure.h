// One run of `lamina run` as a child process, and the figures it leaves.
#pragma once

#include <array>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/benchmark/cases.h"
#include "tools/benchmark/child.h"
#include "tools/benchmark/figures.h"

namespace lamina {

// As the columns of frames.csv are called, without "_ms".
inline constexpr std::array<const char*, 6> kBenchStages = {"read",     "prepare", "cluster",
                                                            "odometry", "map",     "solve"};
using StageTimes = std::array<double, kBenchStages.size()>;  // ms

// Wall times of each scan. Throws InputError: no such file, a missing column, what is no number.
std::vector<StageTimes> ReadStageTimes(const std::string& frames_csv);
// Their means over the scans from `first` on.
StageTimes MeanStages(const std::vector<StageTimes>& scans, std::size_t first);
// Such means as CPU time: cpu_ms, that of all scans a frame, goes to the stages as their wall time
// does. So another program that takes the processor in between lengthens none of them.
StageTimes StageCpu(const std::vector<StageTimes>& scans, std::size_t first, double cpu_ms);

struct MeasuredRun {
  ChildUsage usage;
  nlohmann::json summary;  // summary.json
  std::vector<StageTimes> stages;
};

// The command line that maps the first `frames` scans of the case into `out`.
std::vector<std::string> RunCommandLine(const std::string& lamina, const BenchCase& bench_case,
                                        int threads, std::size_t frames, const std::string& out);

// Throws OutputError if the run fails, InputError if its results cannot be read.
MeasuredRun MeasureRun(const std::string& lamina, const BenchCase& bench_case, int threads,
                       std::size_t frames, const std::string& out);

// Adds a run to the figures of the row:
//
//   cpu_ms, wall_ms, frames_per_s   a frame, from the first scan read to the last one mapped
//   process_cpu_s                   from start to end of the process, results written
//   read_ms ... solve_ms            its share of each stage (StageCpu)
//   peak_rss_mb, map_mb, bytes_a_leaf
//   searched, lost                  frames
void AddRun(const MeasuredRun& run, BenchRow* row);

}  // namespace lamina
