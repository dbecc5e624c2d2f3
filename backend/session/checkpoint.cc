#include "backend/session/checkpoint.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "backend/session/room.h"
#include "backend/session/scan_record.h"
#include "backend/session/session.h"
#include "core/base/error.h"
#include "core/base/stopwatch.h"
#include "io/file/disk_room.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kKept = 2;
// Of the map, copied between two scans: a millisecond or two.
constexpr std::size_t kPieceBytes = 2 << 20;

double SteadySeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Throws InputError naming the file.
template <typename Read>
void ReadState(const std::string& path, std::string_view bytes, const Read& read) {
  try {
    StateArchive archive(bytes);
    read(archive);
    if (archive.unread() > 0) throw InputError("saved state is longer than it should be");
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", path, error.what()));
  }
}

}  // namespace

std::string CheckpointName(std::int64_t scans) { return fmt::format("checkpoint-{}.lmap", scans); }

std::vector<std::int64_t> CheckpointsIn(const std::string& folder) {
  std::vector<std::int64_t> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    long long scans = 0;
    if (std::sscanf(name.c_str(), "checkpoint-%lld.lmap", &scans) == 1 &&
        name == CheckpointName(scans)) {
      found.push_back(scans);
    }
  }
  std::sort(found.begin(), found.end(), std::greater<>());
  return found;
}

void ReadCheckpoint(const std::string& path, const std::string& fixed_options, CheckpointPart part,
                    Mapping* mapping) {
  CheckpointReader reader(path);
  VoxelMap& map = mapping->map();
  std::string tag, bytes, options, pipe;
  std::int64_t scans = -1;
  while (reader.Next(&tag, &bytes)) {
    if (tag == "PIPE") {
      pipe.swap(bytes);  // it needs the map
    } else if (tag == "HEAD") {
      ReadState(path, bytes, [&](StateArchive& a) { a(&scans, &options); });
    } else if (tag == "MAPC") {
      ReadState(path, bytes, [&](StateArchive& a) { map.ArchiveCounters(a); });
    } else if (tag == "ROOT") {
      ReadState(path, "", [&](StateArchive&) { map.Load(bytes); });
    }
    if (options != fixed_options) {
      throw InputError(fmt::format("{}: was made with other options", path));
    }
  }
  if (fs::path(path).filename() != CheckpointName(scans)) {
    throw InputError(fmt::format("{}: is in truth of {} scans", path, scans));
  }
  map.FinishLoading();
  if (part == CheckpointPart::kMap) return;
  ReadState(path, pipe, [&](StateArchive& a) { mapping->Archive(a); });
}

// A checkpoint on its way. The mapping thread fills it, the housekeeping thread writes it.
struct Session::SnapshotJob {
  std::int64_t scans = 0;
  std::unique_ptr<CheckpointWriter> writer;  // housekeeping
  std::atomic<bool> failed{false};
  std::atomic<int> unwritten{0};  // sections
  double longest_pause_ms = 0.0;  // mapping
  Stopwatch since_begin;
};

void Session::BeginCheckpoint() {
  Stopwatch pause;
  mapping_->Settle();
  checkpoint_requested_ = false;
  job_ = std::make_shared<SnapshotJob>();
  job_->scans = last_checkpoint_ = next_;
  taken_at_checkpoint_ = tiles_->taken();
  tiles_->Commit();
  StateArchive head, counters;
  head(&job_->scans, &setup_.fixed_options);
  mapping_->map().ArchiveCounters(counters);
  state_->written().clear();
  mapping_->Archive(*state_);
  mapping_->map().BeginSnapshot();
  Write("HEAD", std::make_shared<std::string>(std::move(head.written())));
  Write("MAPC", std::make_shared<std::string>(std::move(counters.written())));
  Write("PIPE", {state_, &state_->written()});
  job_->longest_pause_ms = pause.Milliseconds();
}

void Session::Write(const std::string& tag, std::shared_ptr<const std::string> bytes) {
  ++job_->unwritten;
  housekeeping_->Do([this, job = job_, tag, bytes = std::move(bytes)] {
    const auto count = [](SnapshotJob* written) { --written->unwritten; };
    const std::unique_ptr<SnapshotJob, decltype(count)> at_the_end(job.get(), count);
    if (job->failed) return;
    try {
      if (!job->writer) {
        job->writer = std::make_unique<CheckpointWriter>(Path(CheckpointName(job->scans)));
      }
      job->writer->Write(tag, *bytes);
    } catch (...) {
      job->failed = true;
      job->writer.reset();  // the half file goes at once
      throw;
    }
  });
}

void Session::ContinueCheckpoint() {
  if (job_->unwritten > 0) return;
  Stopwatch pause;
  const bool more = mapping_->map().ContinueSnapshot(kPieceBytes, piece_.get());
  Write("ROOT", piece_);
  job_->longest_pause_ms = std::max(job_->longest_pause_ms, pause.Milliseconds());
  if (more) return;
  housekeeping_->Do([this, job = job_] { FinishCheckpoint(job.get()); });
  job_.reset();
}

// On the housekeeping thread.
void Session::FinishCheckpoint(SnapshotJob* job) {
  if (job->failed) return;
  log_->WaitDurable();
  tiles_->SyncToDisk();
  job->writer->Commit();
  newest_checkpoint_ = job->scans;
  tidy_ = Tidy::kFirst;
  try {
    BackUpDatabase();
  } catch (const OutputError& error) {
    // Old checkpoints and files go all the same: they may be what takes the room.
    spdlog::warn("{}; the copy of the database stays that of {} scans, until there is room for it",
                 error.what(), backed_up_);
  }
  oldest_kept_ = RemoveOldCheckpoints();
  if (hooks_.on_checkpoint) {
    hooks_.on_checkpoint(
        {job->scans, job->writer->bytes(), job->longest_pause_ms, job->since_begin.Milliseconds()},
        oldest_kept_);
  }
}

// The journal of the tiles begins anew only when all of it is in the file at a moment when nothing
// is being written; but every scan writes. So once the long part is done, what has come since is
// brought in beside the mapping, and what then is left, some scans' worth, by the mapping itself.
void Session::TidyTiles() {
  if (tidy_ == Tidy::kFirst) {
    tidy_ = Tidy::kUnderWay;
    tiles_->Commit();
    housekeeping_->Do([this] {
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
std::int64_t Session::RemoveOldCheckpoints() const {
  const std::vector<std::int64_t> there = CheckpointsIn(setup_.folder);
  std::int64_t oldest = 0;
  bool backed_up = false;
  for (std::size_t i = 0; i < there.size(); ++i) {
    const bool first_backed_up = !backed_up && there[i] <= backed_up_;
    if (i < kKept || first_backed_up) {
      oldest = i + 1 < kKept ? 0 : there[i];
    } else {
      std::error_code ignored;
      fs::remove(Path(CheckpointName(there[i])), ignored);
    }
    backed_up = backed_up || there[i] <= backed_up_;
  }
  return backed_up ? oldest : 0;
}

// With each checkpoint: before, the files of scans cannot be released, and what has left the tiles
// cannot be forgotten.
void Session::BackUpDatabase() {
  // A copy of the whole that found no room is not tried again at each checkpoint.
  constexpr double kRetryS = 600.0;
  SessionDatabase(Path("session.db"), false).Tidy();
  const double now_s = SteadySeconds();
  if (now_s < backup_retry_s_) return;
  backup_retry_s_ = now_s + kRetryS;  // if it fails
  backed_up_ = backup_.Update(kWorkingRoomBytes);
  backup_retry_s_ = 0.0;
}

// Not while scans are repeated: the files hold these, and would lose the last of them for a time.
void Session::PublishTrajectory() {
  const double now_s = SteadySeconds();
  const bool repeating = next_ < repeat_from_ + static_cast<std::int64_t>(to_repeat_.size());
  if (next_ == published_ || now_s < trajectory_due_s_ || repeating || publishing_) return;
  published_ = next_;
  publishing_ = true;
  trajectory_due_s_ = now_s + setup_.session.trajectory_period_s;
  const auto open = std::make_shared<std::vector<FinalPose>>();
  mapping_->ShowOpenPoses([&](const FinalPose& pose) { open->push_back(pose); });
  publisher_->Do([this, open, scans = next_] {
    const auto end = [](std::atomic<bool>* publishing) { *publishing = false; };
    const std::unique_ptr<std::atomic<bool>, decltype(end)> at_the_end(&publishing_, end);
    log_->WaitDurable();
    trajectory_.Publish(SessionDatabase(Path("session.db"), false), scans, *open);
  });
}

}  // namespace lamina
