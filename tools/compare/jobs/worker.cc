// The process of one job: RunCompareWorker.
#include <unistd.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/base/error.h"
#include "io/file/text_input.h"
#include "io/map/trajectory_io.h"
#include "tools/cli/common.h"
#include "tools/compare/jobs/jobs.h"
#include "tools/compare/jobs/task.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {
namespace {

void RunTask(const CompareTask& task, const std::function<void(CompareRow)>& on_row) {
  CompareInput input;
  input.config = LoadCompareConfig(task.config, {});
  const auto scans = OpenScans(task.scans, input.config.lamina.scans);
  input.scans = scans.get();
  input.resolution_m = task.resolution_m;
  input.max_iterations = task.max_iterations;
  if (!task.initial.empty()) {
    for (const StampedPose& pose : ReadTrajectory(task.initial)) {
      input.initial.push_back(pose.T_world_lidar);
    }
  }
  const auto progress = [] {
    const char step = '.';
    // A closed pipe is no reason to stop.
    static_cast<void>(!write(kProgressFd, &step, 1));
  };
  RunCompareJob(task.methods, input, progress, on_row);
}

}  // namespace

int RunCompareWorker(const std::string& task_path) {
  const CompareTask task = TaskFromJson(nlohmann::json::parse(ReadFile(task_path)));
  const auto one_thread = LimitThreads(1);
  CompareJob left = task.methods;
  const auto on_row = [&](CompareRow row) {
    row.sequence = task.sequence;
    row.fingerprint = task.fingerprint;
    row.peak_rss_bytes = PeakRssBytes();
    WriteRow(RowPath(task.row_folder, row.method), row);
    left.erase(std::find(left.begin(), left.end(), row.method));
  };
  try {
    RunTask(task, on_row);
  } catch (const OutputError&) {
    throw;
  } catch (const std::exception& error) {
    for (const std::string& method : CompareJob(left)) {
      CompareRow row;
      row.method = method;
      row.reason = error.what();
      on_row(row);
    }
  }
  return 0;
}

}  // namespace lamina
