#include "tools/benchmark/measure.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <limits>
#include <numeric>

#include "core/base/error.h"
#include "io/file/file_writer.h"
#include "io/file/text_input.h"
#include "tools/results/piece_poses.h"
#include "tools/results/verdict/verdict.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

constexpr double kMegabyte = 1048576.0;

double Number(const nlohmann::json& summary, const char* key) {
  const auto at = summary.find(key);
  return at != summary.end() && at->is_number() ? at->get<double>()
                                                : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

std::vector<StageTimes> ReadStageTimes(const std::string& path) {
  const std::string text = ReadFile(path);
  LineReader lines(path, text);
  if (!lines.Next()) throw InputError(path + ": is empty");
  const std::vector<std::string_view> names = SplitAtCommas(lines.line());
  std::array<std::size_t, kBenchStages.size()> columns{};
  for (std::size_t k = 0; k < columns.size(); ++k) {
    const auto at = std::find(names.begin(), names.end(), std::string(kBenchStages[k]) + "_ms");
    if (at == names.end()) lines.Fail(fmt::format("names no column {}_ms", kBenchStages[k]));
    columns[k] = static_cast<std::size_t>(at - names.begin());
  }
  std::vector<StageTimes> scans;
  while (lines.Next()) {
    const std::vector<std::string_view> cells = SplitAtCommas(lines.line());
    StageTimes times{};
    for (std::size_t k = 0; k < columns.size(); ++k) {
      if (columns[k] >= cells.size() || !ParseNumber(cells[columns[k]], &times[k]))
        lines.Fail(fmt::format("has no number for {}_ms", kBenchStages[k]));
    }
    scans.push_back(times);
  }
  return scans;
}

StageTimes MeanStages(const std::vector<StageTimes>& scans, std::size_t first) {
  StageTimes mean{};
  for (std::size_t i = first; i < scans.size(); ++i) {
    for (std::size_t k = 0; k < mean.size(); ++k) mean[k] += scans[i][k];
  }
  for (double& m : mean) m /= static_cast<double>(scans.size() - first);
  return mean;
}

StageTimes StageCpu(const std::vector<StageTimes>& scans, std::size_t first, double cpu_ms) {
  const StageTimes all = MeanStages(scans, 0);
  StageTimes stages = MeanStages(scans, first);
  for (double& ms : stages) ms *= cpu_ms / std::accumulate(all.begin(), all.end(), 0.0);
  return stages;
}

std::vector<std::string> RunCommandLine(const std::string& lamina, const BenchCase& bench_case,
                                        int threads, std::size_t frames, const std::string& out) {
  std::vector<std::string> argv{lamina,       "run",
                                "--scans",    bench_case.scans,
                                "--out",      out,
                                "--threads",  std::to_string(threads),
                                "--frames",   fmt::format("0:{}", frames),
                                "--progress", "off"};
  if (!bench_case.config.empty()) argv.insert(argv.end(), {"--config", bench_case.config});
  for (const std::string& key_value : bench_case.set) argv.insert(argv.end(), {"--set", key_value});
  return argv;
}

MeasuredRun MeasureRun(const std::string& lamina, const BenchCase& bench_case, int threads,
                       std::size_t frames, const std::string& out) {
  MakeDirectory(out);
  const fs::path folder(out);
  MeasuredRun run;
  run.usage = RunChildWell(RunCommandLine(lamina, bench_case, threads, frames, out),
                           (folder / "log.txt").string(), kProbablyWrong);
  const std::string path = (folder / "summary.json").string();
  run.summary = nlohmann::json::parse(ReadFile(path), nullptr, false);
  if (!run.summary.is_object()) throw InputError(path + ": is no JSON object");
  run.stages = ReadStageTimes((folder / "frames.csv").string());
  if (run.stages.empty()) throw InputError((folder / "frames.csv").string() + ": names no scan");
  return run;
}

void AddRun(const MeasuredRun& run, BenchRow* row) {
  const nlohmann::json& summary = run.summary;
  row->Add("cpu_ms", "ms", Number(summary, "cpu_ms_per_frame"));
  row->Add("wall_ms", "ms", 1e3 / Number(summary, "frames_per_s"));
  row->Add("frames_per_s", "1/s", Number(summary, "frames_per_s"));
  row->Add("process_cpu_s", "s", run.usage.cpu_s);
  const StageTimes stages = StageCpu(run.stages, 0, Number(summary, "cpu_ms_per_frame"));
  for (std::size_t k = 0; k < stages.size(); ++k)
    row->Add(std::string(kBenchStages[k]) + "_ms", "ms", stages[k]);
  row->Add("peak_rss_mb", "MB", Number(summary, "peak_rss_bytes") / kMegabyte);
  row->Add("map_mb", "MB", Number(summary, "map_peak_bytes") / kMegabyte, true);
  row->Add("bytes_a_leaf", "B", Number(summary, "map_bytes") / Number(summary, "map_leaves"), true);
  row->Add("searched", "frames", Number(summary, "searched_frames"), true);
  row->Add("lost", "frames", Number(summary, "lost_frames"), true);
}

}  // namespace lamina
