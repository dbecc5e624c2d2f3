// Jobs of a comparison, each in a process of its own: it can be stopped when its time is up, what
// it takes of memory is its own, and what ends it ends nothing else.
//
// A job is this very program, called with a hidden option and a task file. It runs on one thread,
// so that times compare, writes a row file for each method, and a byte to a pipe for each step.
#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "tools/compare/methods.h"

namespace lamina {

struct CompareTask {
  CompareJob methods;
  std::string sequence, fingerprint;
  std::string scans;    // path for OpenScans
  std::string initial;  // KITTI poses, one for each scan; may be empty for global methods
  std::string config;   // YAML
  double resolution_m = 0.0;
  int max_iterations = 0;  // of bundle adjustment's solver; 0: as CompareInput says
  std::string row_folder;
  double time_limit_s = 0.0;  // of processor time; four times this of wall time
};

// Where the row of a method is kept.
std::string RowPath(const std::string& row_folder, const std::string& method);

struct CompareJobReports {
  // A step of a job; called for all steps of it, at its end if not before.
  std::function<void()> on_step;
  // A row that failed, for a message.
  std::function<void(const CompareRow&)> on_failure;
};

// Number of steps that a task reports.
std::size_t StepsOf(const CompareTask& task, std::size_t scans);

// Runs all tasks, `at_once` of them at any time, in this order. A job that ends without a row for a
// method gets a row that says why: time limit, signal, exit code. Once `stop` is set jobs are
// ended, finished rows stay, and it returns false. Throws OutputError.
bool RunCompareTasks(const std::vector<CompareTask>& tasks, std::size_t scans, std::size_t at_once,
                     const std::atomic<bool>& stop, const CompareJobReports& reports);

// The other side: runs the task of the file, returns the exit code.
int RunCompareWorker(const std::string& task_path);

}  // namespace lamina
