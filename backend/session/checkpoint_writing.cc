#include "backend/session/checkpoint_writing.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "backend/loops/piece_loops.h"
#include "backend/session/checkpoint.h"
#include "backend/session/room.h"
#include "core/base/error.h"
#include "core/base/stopwatch.h"
#include "io/store/checkpoint_file.h"
#include "io/store/session_database.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kKept = 2, kMostTasksWaiting = 256;
// Of the map, copied between two scans: a millisecond or two.
constexpr std::size_t kPieceBytes = 2 << 20;

}  // namespace

// A checkpoint on its way. The mapping thread fills it, the housekeeping thread writes it.
struct CheckpointWriting::Job {
  std::int64_t scans = 0;
  std::vector<StoredBytes> submaps;          // that it needs
  std::unique_ptr<CheckpointWriter> writer;  // housekeeping
  std::atomic<bool> failed{false};
  std::atomic<int> unwritten{0};  // sections
  double longest_pause_ms = 0.0;  // mapping
  Stopwatch since_begin;
};

CheckpointWriting::CheckpointWriting(const SessionFolder& folder, std::string fixed_options,
                                     Mapping* mapping, const SessionStores& stores, SessionLog* log,
                                     std::int64_t loaded, OnCheckpoint on_checkpoint)
    : folder_(folder),
      fixed_options_(std::move(fixed_options)),
      mapping_(mapping),
      tiles_(stores.tiles),
      submaps_(stores.submaps),
      log_(log),
      on_checkpoint_(std::move(on_checkpoint)),
      last_(loaded),
      newest_(loaded),
      backed_up_(SessionBackup::Scans(folder.Path("session.db.backup"))),
      backup_(folder.Path("session.db"), folder.Path("session.db.backup")),
      housekeeping_(LogFailure, kMostTasksWaiting) {}

void CheckpointWriting::AfterScan(std::int64_t scans, int every_scans) {
  // What has gone to disk and come back is written out, and what no checkpoint that is kept needs
  // is removed, in small portions: all of it at the next checkpoint would be a pause.
  constexpr std::int64_t kScansPerCommit = 10;
  if (scans % kScansPerCommit == 0) {
    tiles_->Forget(oldest_kept_ - 1);
    tiles_->Commit();
  }
  if (job_) {
    Continue();
  } else if (requested_ || TilesTurnedOver() || scans - last_ >= every_scans) {
    Begin(scans);
  }
  TidyTiles();
}

bool CheckpointWriting::Idle(std::int64_t scans) {
  if (job_) {
    Continue();
  } else if (requested_) {
    Begin(scans);
  }
  return job_ != nullptr;
}

void CheckpointWriting::CompleteJob() {
  while (job_) {
    housekeeping_.Wait();
    Continue();
  }
  housekeeping_.Wait();
}

void CheckpointWriting::Complete(std::int64_t scans) {
  if (scans <= newest_ && !requested_) return;
  CompleteJob();
  if (scans > newest_ || requested_) Begin(scans);
  CompleteJob();
}

void CheckpointWriting::Begin(std::int64_t scans) {
  Stopwatch pause;
  mapping_->TakeInDueSolves();
  requested_ = false;
  job_ = std::make_shared<Job>();
  job_->scans = last_ = scans;
  if (mapping_->loops() != nullptr) job_->submaps = mapping_->loops()->StoredPlaces();
  taken_at_checkpoint_ = tiles_->taken();
  tiles_->Commit();
  StateArchive head, counters;
  std::string options = fixed_options_;
  std::uint64_t tiles = tiles_->records();
  head(&job_->scans, &options, &tiles);
  mapping_->map().ArchiveCounters(counters);
  state_->written().clear();
  mapping_->Archive(*state_);
  mapping_->map().BeginSnapshot();
  Write("HEAD", std::make_shared<std::string>(std::move(head.written())));
  Write("MAPC", std::make_shared<std::string>(std::move(counters.written())));
  Write("PIPE", {state_, &state_->written()});
  job_->longest_pause_ms = pause.Milliseconds();
}

void CheckpointWriting::Write(const std::string& tag, std::shared_ptr<const std::string> bytes) {
  ++job_->unwritten;
  housekeeping_.Do([this, job = job_, tag, bytes = std::move(bytes)] {
    const auto count = [](Job* written) { --written->unwritten; };
    const std::unique_ptr<Job, decltype(count)> at_the_end(job.get(), count);
    if (job->failed) return;
    try {
      if (!job->writer) {
        job->writer = std::make_unique<CheckpointWriter>(folder_.Path(CheckpointName(job->scans)));
      }
      job->writer->Write(tag, *bytes);
    } catch (...) {
      job->failed = true;
      job->writer.reset();  // the half file goes at once
      throw;
    }
  });
}

void CheckpointWriting::Continue() {
  if (job_->unwritten > 0) return;
  Stopwatch pause;
  const bool more = mapping_->map().ContinueSnapshot(kPieceBytes, piece_.get());
  Write("ROOT", piece_);
  job_->longest_pause_ms = std::max(job_->longest_pause_ms, pause.Milliseconds());
  if (more) return;
  housekeeping_.Do([this, job = job_] { FinishJob(job.get()); });
  job_.reset();
}

void CheckpointWriting::FinishJob(Job* job) {
  if (job->failed) return;
  log_->WaitDurable();
  tiles_->SyncToDisk();
  if (submaps_ != nullptr) submaps_->SyncToDisk();
  job->writer->Commit();
  newest_ = job->scans;
  tidy_ = Tidy::kFirst;
  try {
    BackUpDatabase();
  } catch (const OutputError& error) {
    // Old checkpoints and files go all the same: they may be what takes the room.
    spdlog::warn("{}; the copy of the database stays that of {} scans, until there is room for it",
                 error.what(), backed_up_);
  }
  oldest_kept_ = RemoveOld();
  ReleaseSubmaps(std::move(job->submaps));
  if (on_checkpoint_) {
    on_checkpoint_(
        {job->scans, job->writer->bytes(), job->longest_pause_ms, job->since_begin.Milliseconds()},
        oldest_kept_);
  }
}

// Two checkpoints are kept: what neither of them needs goes.
void CheckpointWriting::ReleaseSubmaps(std::vector<StoredBytes> needed) {
  if (submaps_ == nullptr) return;
  std::vector<StoredBytes> kept = std::exchange(submaps_before_, std::move(needed));
  if (kept.empty()) return;
  kept.insert(kept.end(), submaps_before_.begin(), submaps_before_.end());
  submaps_->KeepOnly(kept);
}

// The journal of the tiles begins anew only when all of it is in the file at a moment when nothing
// is being written; but every scan writes. So once the long part is done, what has come since is
// brought in beside the mapping, and what then is left, some scans' worth, by the mapping itself.
void CheckpointWriting::TidyTiles() {
  if (tidy_ == Tidy::kFirst) {
    tidy_ = Tidy::kUnderWay;
    tiles_->Commit();
    housekeeping_.Do([this] {
      tiles_->SyncToDisk();
      tidy_ = Tidy::kLast;
    });
  } else if (tidy_ == Tidy::kLast) {
    tidy_ = Tidy::kDone;
    tiles_->Commit();
    tiles_->SyncToDisk();
  }
}

// Keeps the newest checkpoints, and the newest of those that the copy of the database can continue
// from. Returns the scans of the oldest one kept; 0 while there is none to fall back on.
std::int64_t CheckpointWriting::RemoveOld() const {
  const std::vector<std::int64_t> there = CheckpointsIn(folder_.path());
  std::int64_t oldest = 0;
  bool backed_up = false;
  for (std::size_t i = 0; i < there.size(); ++i) {
    const bool first_backed_up = !backed_up && there[i] <= backed_up_;
    if (i < kKept || first_backed_up) {
      oldest = i + 1 < kKept ? 0 : there[i];
    } else {
      std::error_code ignored;
      fs::remove(folder_.Path(CheckpointName(there[i])), ignored);
    }
    backed_up = backed_up || there[i] <= backed_up_;
  }
  return backed_up ? oldest : 0;
}

// With each checkpoint: before, the files of scans cannot be released, and what has left the tiles
// cannot be forgotten.
void CheckpointWriting::BackUpDatabase() {
  // A copy of the whole that found no room is not tried again at each checkpoint.
  constexpr double kRetryS = 600.0;
  SessionDatabase(folder_.Path("session.db"), false).Tidy();
  const double now_s = 1e-3 * clock_.Milliseconds();
  if (now_s < backup_retry_s_) return;
  backup_retry_s_ = now_s + kRetryS;  // if it fails
  backed_up_ = backup_.Update(kWorkingRoomBytes);
  backup_retry_s_ = 0.0;
}

// What has come back from disk stays in the file of the tiles until two more checkpoints are there:
// with one for each sixth of the map that comes back, that is half of what is alive at most.
bool CheckpointWriting::TilesTurnedOver() const {
  constexpr std::size_t kLeast = 200;
  const std::size_t alive = std::max(tiles_->records(), mapping_->map().roots());
  return tiles_->taken() - taken_at_checkpoint_ > std::max(kLeast, alive / 6);
}

}  // namespace lamina
