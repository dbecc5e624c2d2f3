// Keeps the trajectory files of a session current, on a thread of its own, with one publication
// under way at most: no piece of a checkpoint waits for it.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "backend/mapping/mapping.h"
#include "backend/session/folder.h"
#include "backend/session/log.h"
#include "backend/session/trajectory_files.h"
#include "core/base/stopwatch.h"
#include "core/base/worker_thread.h"
#include "io/store/session_database.h"

namespace lamina {

// Of the mapping thread.
class TrajectoryPublisher {
 public:
  // All must outlive it.
  TrajectoryPublisher(const SessionFolder& folder, const Mapping* mapping, SessionLog* log);

  // Begins a publication of `scans` scans if the last one is so old, and none is under way. Of long
  // ones there are fewer.
  void PublishIfDue(std::int64_t scans, double period_s);
  // Publishes now; `tail` are the poses that are not final in the database.
  void PublishLast(const SessionDatabase& database, std::int64_t scans,
                   const std::vector<FinalPose>& tail);
  // Until what was begun is on disk.
  void Wait() { thread_.Wait(); }

 private:
  // Begins the files anew if poses have been corrected since.
  void TakeInCorrections();

  const SessionFolder& folder_;
  const Mapping* mapping_;
  SessionLog* log_;
  Stopwatch clock_;
  double due_s_ = 0.0;
  std::atomic<std::int64_t> published_{0};  // scans in the files
  std::atomic<bool> under_way_{false};
  std::atomic<double> took_s_{0.0};         // the last publication
  std::int64_t corrections_ = 0;            // by loops, that are in the files
  std::unique_ptr<TrajectoryFiles> files_;  // of the thread, while one is under way
  WorkerThread thread_;                     // the last member: it ends before what it works on goes
};

}  // namespace lamina
