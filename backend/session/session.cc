#include "backend/session/session.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <sstream>
#include <utility>

#include "backend/mapping/pipeline.h"
#include "backend/session/checkpoint.h"
#include "backend/session/room.h"
#include "backend/session/scan_record.h"
#include "core/base/error.h"
#include "io/file/disk_room.h"
#include "io/file/file_writer.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

constexpr const char* kFixedOptions = "fixed_options";

void MoveAwayDamaged(const std::string& database) {
  for (const char* ending : {"", "-wal", "-shm"}) {
    std::error_code ignored;
    fs::rename(database + ending, database + ".damaged" + ending, ignored);
  }
}

// What a process that was killed has left of files that were to be whole.
void RemovePartialFiles(const std::string& folder) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string ending = entry.path().extension().string();
    std::error_code ignored;
    if (ending == ".partial" || ending == ".partial-journal") fs::remove(entry.path(), ignored);
  }
}

std::string OwnerOf(int lock) {
  char owner[32] = {};
  const ssize_t length = pread(lock, owner, sizeof(owner) - 1, 0);
  return length > 0 ? owner : "?";
}

// Keeps a session as it is while its map is read: no process can begin to work on it.
class ReadingLock {
 public:
  // Throws InputError if a process works on it.
  explicit ReadingLock(const std::string& session)
      : file_(open((fs::path(session) / "lock").c_str(), O_RDONLY | O_CLOEXEC)) {
    // Without the file no process has ever worked on it.
    if (file_ < 0 || flock(file_, LOCK_SH | LOCK_NB) == 0) return;
    const std::string owner = OwnerOf(file_);
    close(file_);
    throw InputError(fmt::format(
        "{}: the session is in use by process {}: to localise in its map, end that first", session,
        owner));
  }
  ~ReadingLock() {
    if (file_ >= 0) close(file_);
  }
  ReadingLock(const ReadingLock&) = delete;
  ReadingLock& operator=(const ReadingLock&) = delete;

 private:
  int file_;
};

// The first lines that differ.
std::pair<std::string, std::string> FirstDifference(const std::string& a, const std::string& b) {
  std::istringstream lines_a(a), lines_b(b);
  std::string line_a, line_b;
  while (line_a == line_b && (lines_a || lines_b)) {
    if (!std::getline(lines_a, line_a)) line_a.clear();
    if (!std::getline(lines_b, line_b)) line_b.clear();
  }
  return {line_a, line_b};
}

}  // namespace

void SessionOptions::Visit(OptionVisitor& v) {
  v.Integer("checkpoint_every_scans", &checkpoint_every_scans, 1, 1000000);
  v.Number("trajectory_period_s", &trajectory_period_s, 0.01, 1e6);
}

Session::Session(SessionSetup setup, SessionHooks hooks)
    : setup_(std::move(setup)),
      hooks_(std::move(hooks)),
      trajectory_(setup_.folder),
      backup_(Path("session.db"), Path("session.db.backup")) {
  CheckOptions(setup_.session, "session");
  Lock();
  try {
    RemovePartialFiles(setup_.folder);
    backed_up_ = SessionBackup::Scans(Path("session.db.backup"));
    OpenDatabase();
    CheckFixedOptions();
    OpenTiles();
    LoadNewestCheckpoint();
  } catch (...) {
    close(lock_);
    throw;
  }
  next_ = repeat_from_ = last_checkpoint_;
  tiles_->SetScan(next_);
  database_->DropSolvesFrom(next_);
  database_->ForEach(next_, database_->scans(),
                     [this](const SessionScan& scan) { to_repeat_.push_back(scan); });
  if (!to_repeat_.empty()) {
    spdlog::info(
        "continuing after scan {}: {} scans were recorded since the last checkpoint and "
        "are mapped again",
        next_ - 1, to_repeat_.size());
  }
  log_ = std::make_unique<SessionLog>(Path("session.db"), hooks_.on_durable);
  const auto failed = [](const std::exception& error) {
    spdlog::error("{} (the stream goes on; this will be tried again)", error.what());
  };
  constexpr std::size_t kMostWaiting = 256;
  housekeeping_ = std::make_unique<WorkerThread>(failed, kMostWaiting);
  publisher_ = std::make_unique<WorkerThread>(failed, 1);
}

Session::~Session() {
  publisher_.reset();
  housekeeping_.reset();
  log_.reset();
  mapping_.reset();
  tiles_.reset();
  if (lock_ >= 0) close(lock_);
}

std::string Session::Path(const std::string& name) const {
  return (fs::path(setup_.folder) / name).string();
}

// The lock goes with the process, however it ends.
void Session::Lock() {
  MakeDirectory(setup_.folder);
  const std::string path = Path("lock");
  lock_ = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (lock_ < 0) throw OutputError(fmt::format("{}: {}", path, std::strerror(errno)));
  if (flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    const bool is_read = flock(lock_, LOCK_SH | LOCK_NB) == 0;
    const std::string owner = OwnerOf(lock_);
    close(lock_);
    if (is_read) {
      throw InputError(fmt::format(
          "{}: another session is copying the map of this one, to localise in it; start again when "
          "it has",
          setup_.folder));
    }
    throw InputError(fmt::format("{}: the session is in use by process {}", setup_.folder, owner));
  }
  const std::string pid = std::to_string(getpid());
  if (ftruncate(lock_, 0) != 0 || write(lock_, pid.data(), pid.size()) < 0) {
    close(lock_);
    throw OutputError(fmt::format("{}: cannot be written: {}", path, std::strerror(errno)));
  }
}

void Session::OpenDatabase() {
  const std::string path = Path("session.db"), backup = Path("session.db.backup");
  try {
    database_ = std::make_unique<SessionDatabase>(path, true);
    // A file that is gone or cut to nothing makes a new database.
    if (database_->Meta(kFixedOptions) || !fs::exists(backup)) return;
    database_.reset();
    spdlog::error("{}: has lost all that was in it; going back to the copy of the last checkpoint",
                  path);
  } catch (const OtherFormatError&) {
    throw;
  } catch (const InputError& error) {
    if (!fs::exists(backup)) throw;
    spdlog::error("{}; going back to the copy of the last checkpoint", error.what());
  }
  MoveAwayDamaged(path);
  SessionBackup::RollBack(backup);
  CopyFile(backup, path);
  database_ = std::make_unique<SessionDatabase>(path, true);
}

void Session::OpenTiles() {
  const std::string path = Path("map_tiles.db");
  try {
    tiles_ = std::make_unique<TileStore>(path, TileStore::Lifetime::kKept);
  } catch (const InputError& error) {
    spdlog::error("{}; the places it held are mapped anew when the sensor comes back to them",
                  error.what());
    MoveAwayDamaged(path);
    tiles_ = std::make_unique<TileStore>(path, TileStore::Lifetime::kKept);
  }
}

void Session::CheckFixedOptions() {
  const std::optional<std::string> before = database_->Meta(kFixedOptions);
  if (!before) {
    database_->SetMeta(kFixedOptions, setup_.fixed_options);
    return;
  }
  if (*before == setup_.fixed_options) return;
  const auto [was, is] = FirstDifference(*before, setup_.fixed_options);
  throw OptionError(fmt::format(
      "{}: the session was begun with other options and can only be continued with the same: it "
      "has '{}', now given '{}'",
      setup_.folder, was, is));
}

void Session::BeginLocalising() {
  const BaseMap& base = *setup_.base_map;
  const ReadingLock lock(base.session);
  for (const std::int64_t scans : CheckpointsIn(base.session)) {
    try {
      mapping_ = std::make_unique<Mapping>(setup_.mapping, Callbacks(), tiles_.get());
      ReadCheckpoint((fs::path(base.session) / CheckpointName(scans)).string(), base.fixed_options,
                     CheckpointPart::kMap, mapping_.get());
      if (!mapping_->map().HasPiece(0)) {
        throw InputError(fmt::format("{}: no scan of the first piece of the map was ever matched",
                                     CheckpointName(scans)));
      }
      tiles_->CopyFrom((fs::path(base.session) / "map_tiles.db").string(), scans - 1);
      mapping_->StartLocalising(base.T_world_start);
      return;
    } catch (const InputError& error) {
      spdlog::error("{}; trying the checkpoint before it", error.what());
    }
  }
  throw InputError(fmt::format("{}: holds no map that could be used", base.session));
}

// Left where it is, it would count among those kept, and might be taken for one of the scans that
// are mapped in the place of its own.
void Session::SetCheckpointAside(std::int64_t scans, const std::string& why) const {
  const std::string path = Path(CheckpointName(scans));
  spdlog::error("{}; going back to the checkpoint before it", why);
  std::error_code ignored;
  fs::rename(path, path + ".damaged", ignored);
}

void Session::LoadNewestCheckpoint() {
  const std::int64_t recorded = database_->scans();
  for (const std::int64_t scans : CheckpointsIn(setup_.folder)) {
    if (scans > recorded) {
      SetCheckpointAside(scans, fmt::format("{}: the database has lost some of its {} scans",
                                            Path(CheckpointName(scans)), scans));
      continue;
    }
    try {
      mapping_ = std::make_unique<Mapping>(setup_.mapping, Callbacks(), tiles_.get());
      ReadCheckpoint(Path(CheckpointName(scans)), setup_.fixed_options, CheckpointPart::kAll,
                     mapping_.get());
      tiles_->RollBackTo(scans - 1);
      last_checkpoint_ = newest_checkpoint_ = scans;
      return;
    } catch (const InputError& error) {
      SetCheckpointAside(scans, error.what());
    }
  }
  if (recorded > 0) spdlog::warn("no checkpoint can be used: all scans are mapped again");
  tiles_->RollBackTo(-1);
  if (setup_.base_map) {
    BeginLocalising();
  } else {
    mapping_ = std::make_unique<Mapping>(setup_.mapping, Callbacks(), tiles_.get());
  }
}

MappingCallbacks Session::Callbacks() {
  MappingCallbacks callbacks;
  callbacks.on_scan = [this](const MappedScan& report) { OnScan(report); };
  callbacks.on_settled = [this] { OnSettled(); };
  callbacks.on_final_pose = [this](const FinalPose& pose) {
    if (finished_) {
      tail_.push_back(pose);
    } else {
      log_->Finalise({static_cast<std::int64_t>(pose.scan), pose.pose.T_world_lidar, pose.skipped});
    }
    if (hooks_.on_final) hooks_.on_final(pose);
  };
  callbacks.on_solve = [this](const SolveReport& report) {
    if (!finished_) log_->Put(RecordOf(report));
  };
  return callbacks;
}

void Session::Process(StreamedScans* scans, const std::atomic<bool>* stop) {
  scans_ = scans;
  while (next_ < static_cast<std::int64_t>(scans->size()) && !(stop != nullptr && stop->load())) {
    MapScans(*scans, {0, static_cast<std::size_t>(next_), scans->size()}, mapping_.get(), stop);
  }
  scans->Forget(static_cast<std::size_t>(next_));
  scans_ = nullptr;
}

void Session::OnScan(const MappedScan& report) {
  const InboxFile& file = scans_->File(report.index);
  SessionScan row = RecordOf(report);
  row.file = file.name;
  row.sequence = file.sequence;
  row.recorded_stamp = file.recorded_stamp;
  row.next_stamp_ns = file.next_stamp_ns;
  if (FileIsGone(report)) {
    spdlog::error(
        "{}: was mapped before, but cannot be read again; its pose stays, its share of "
        "the map is lost ({})",
        file.name, report.detail);
  } else {
    if (hooks_.on_mapped) hooks_.on_mapped(report, row);
    log_->Put(row);
  }
  ++next_;
  tiles_->SetScan(next_);
  if (hooks_.on_scan) hooks_.on_scan(report, row);
}

void Session::OnSettled() {
  // What has gone to disk and come back is written out, and what no checkpoint that is kept needs
  // is removed, in small portions: all of it at the next checkpoint would be a pause.
  constexpr std::int64_t kScansPerCommit = 10;
  if (next_ % kScansPerCommit == 0) {
    tiles_->Forget(oldest_kept_ - 1);
    tiles_->Commit();
  }
  if (job_) {
    ContinueCheckpoint();
  } else if (checkpoint_requested_ || TilesTurnedOver() ||
             next_ - last_checkpoint_ >= setup_.session.checkpoint_every_scans) {
    BeginCheckpoint();
  }
  TidyTiles();
  PublishTrajectory();
}

// What has come back from disk stays in the file of the tiles until two more checkpoints are there:
// with one for each sixth of the map that comes back, that is half of what is alive at most.
bool Session::TilesTurnedOver() const {
  constexpr std::size_t kLeast = 200;
  const std::size_t alive = std::max(tiles_->records(), mapping_->map().roots());
  return tiles_->taken() - taken_at_checkpoint_ > std::max(kLeast, alive / 6);
}

// Whether a scan that is repeated could be read the first time, and cannot now.
bool Session::FileIsGone(const MappedScan& report) const {
  const auto i = static_cast<std::size_t>(next_ - repeat_from_);
  return i < to_repeat_.size() && !to_repeat_[i].skipped && report.skipped &&
         report.reason == SkipReason::kUnreadable;
}

void Session::SetAside(const std::string& file, const std::string& reason) {
  log_->SetAside(file, reason);
}

bool Session::Idle() {
  if (job_) {
    ContinueCheckpoint();
  } else if (checkpoint_requested_) {
    BeginCheckpoint();
  }
  PublishTrajectory();
  return job_ != nullptr;
}

void Session::CompleteCheckpoint() {
  while (job_) {
    housekeeping_->Wait();
    ContinueCheckpoint();
  }
  housekeeping_->Wait();
}

void Session::WaitForHousekeeping() {
  housekeeping_->Wait();
  publisher_->Wait();
}

void Session::Finish() {
  if (next_ > newest_checkpoint_ || checkpoint_requested_) {
    CompleteCheckpoint();
    if (next_ > newest_checkpoint_ || checkpoint_requested_) BeginCheckpoint();
    CompleteCheckpoint();
  }
  log_->WaitDurable();
  WaitForHousekeeping();
  if (newest_checkpoint_ != next_) {
    const std::string text =
        fmt::format("{}: the last checkpoint could not be written; {} scans will be mapped again",
                    setup_.folder, next_ - newest_checkpoint_);
    if (FreeBytes(setup_.folder) < RoomToContinue(setup_.folder)) throw DiskFullError(text);
    throw OutputError(text);
  }
  finished_ = true;
  tail_.clear();
  mapping_->Finish();
  trajectory_.Publish(*database_, next_, tail_);
}

void Session::ForEachPose(const FinalPoses::Visit& visit) const {
  log_->WaitDurable();
  const std::int64_t open = tail_.empty() ? next_ : static_cast<std::int64_t>(tail_.front().scan);
  database_->ForEach(0, open, [&](const SessionScan& scan) { visit(PoseOf(scan)); });
  for (const FinalPose& pose : tail_) visit(AsRecorded(*database_, pose));
}

}  // namespace lamina
