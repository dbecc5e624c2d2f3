// Checkpoints as they are made: begun after a scan, copied piece by piece between the next ones,
// written beside the mapping. With each come the copy of the database, and an end for what is not
// needed any more.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "backend/mapping/mapping.h"
#include "backend/session/folder.h"
#include "backend/session/log.h"
#include "core/base/stopwatch.h"
#include "core/base/worker_thread.h"
#include "core/geometry/state_archive.h"
#include "io/store/session_backup.h"
#include "io/store/tile_store.h"

namespace lamina {

struct SessionCheckpoint {
  std::int64_t scans = 0;  // that are in it
  std::uint64_t bytes = 0;
  double longest_pause_ms = 0.0;  // of the mapping, for one piece of it
  double total_ms = 0.0;
};

// Of the mapping thread, but for what is atomic. Throws OutputError where the tiles cannot be
// written; what goes wrong on its own thread is logged, and tried again with the next checkpoint.
class CheckpointWriting {
 public:
  // Told on the housekeeping thread. The files of scans before `released` will not be needed again,
  // whatever happens.
  using OnCheckpoint = std::function<void(const SessionCheckpoint&, std::int64_t released)>;

  // All must outlive it. `loaded`: scans of the checkpoint that the session went on from.
  CheckpointWriting(const SessionFolder& folder, std::string fixed_options, Mapping* mapping,
                    const SessionStores& stores, SessionLog* log, std::int64_t loaded,
                    OnCheckpoint on_checkpoint);

  void Request() { requested_ = true; }
  // Scans in the newest one that is whole.
  std::int64_t newest() const { return newest_; }

  // After a scan, `scans` in all: goes on with what is under way, or begins one if it is due.
  void AfterScan(std::int64_t scans, int every_scans);
  // The same without a scan, for one that was requested. False if there is nothing left to do.
  bool Idle(std::int64_t scans);
  // Until one of `scans` scans is there, or cannot be written.
  void Complete(std::int64_t scans);

  // On the housekeeping thread, after what it has to do.
  void DoLater(std::function<void()> work) { housekeeping_.Do(std::move(work)); }
  // Until all that was begun is done.
  void Wait() { housekeeping_.Wait(); }

 private:
  struct Job;

  void Begin(std::int64_t scans);
  void Continue();
  void CompleteJob();
  void Write(const std::string& tag, std::shared_ptr<const std::string> bytes);
  bool TilesTurnedOver() const;
  void TidyTiles();
  // On the housekeeping thread.
  void FinishJob(Job* job);
  void ReleaseSubmaps(std::vector<StoredBytes> needed);
  std::int64_t RemoveOld() const;
  void BackUpDatabase();

  const SessionFolder& folder_;
  const std::string fixed_options_;
  Mapping* mapping_;
  TileStore* tiles_;
  ByteFile* submaps_;                        // may be null
  std::vector<StoredBytes> submaps_before_;  // that the checkpoint before the newest needs
  SessionLog* log_;
  OnCheckpoint on_checkpoint_;
  std::int64_t last_;                    // scans in the last one that was begun
  std::size_t taken_at_checkpoint_ = 0;  // tiles' records until then
  bool requested_ = false;
  std::shared_ptr<Job> job_;
  // What the last checkpoint has beside the map, and its last piece of the map. Kept for their
  // memory: the next ones take the same, and a checkpoint does not show in what the process needs.
  // No piece is begun before the housekeeping thread has written all before it (Continue), so none
  // is overwritten while it is being written.
  std::shared_ptr<StateArchive> state_ = std::make_shared<StateArchive>();
  std::shared_ptr<std::string> piece_ = std::make_shared<std::string>();

  // Of the housekeeping thread, for others to read: numbers of scans.
  std::atomic<std::int64_t> newest_, oldest_kept_{0};
  enum class Tidy { kDone, kFirst, kUnderWay, kLast };
  std::atomic<Tidy> tidy_{Tidy::kDone};
  std::int64_t backed_up_ = 0;  // scans in the copy of the database
  Stopwatch clock_;
  double backup_retry_s_ = 0.0;  // not before, after one that failed
  SessionBackup backup_;
  WorkerThread housekeeping_;  // the last member: it ends before what it works on goes
};

}  // namespace lamina
