#include "backend/session/session.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <utility>

#include "backend/mapping/pipeline.h"
#include "backend/session/recovery.h"
#include "backend/session/room.h"
#include "backend/session/scan_record.h"
#include "core/base/error.h"
#include "io/file/disk_room.h"

namespace lamina {
namespace {

SessionSetup Checked(SessionSetup setup) {
  CheckOptions(setup.session, "session");
  return setup;
}

}  // namespace

void SessionOptions::Visit(OptionVisitor& v) {
  v.Integer("checkpoint_every_scans", &checkpoint_every_scans, 1, 1000000);
  v.Number("trajectory_period_s", &trajectory_period_s, 0.01, 1e6);
}

Session::Session(SessionSetup setup, SessionHooks hooks)
    : setup_(Checked(std::move(setup))), hooks_(std::move(hooks)), folder_(setup_.folder) {
  database_ = folder_.OpenDatabase();
  CheckFixedOptions(setup_, database_.get());
  tiles_ = folder_.OpenTiles();
  if (setup_.mapping.loops.enabled && !setup_.base_map) submaps_ = folder_.OpenSubmaps();
  const SessionStores stores = {tiles_.get(), submaps_.get()};
  RecoveredMapping recovered = RecoverMapping(setup_, folder_, *database_, stores, [this] {
    return std::make_unique<Mapping>(setup_.mapping, Callbacks(), tiles_.get(), submaps_.get());
  });
  mapping_ = std::move(recovered.mapping);
  next_ = repeat_from_ = recovered.scans;
  tiles_->SetScan(next_);
  database_->DropSolvesFrom(next_);
  database_->ForEach(next_, database_->scans(),
                     [this](const ScanRecord& scan) { to_repeat_.push_back(scan); });
  if (!to_repeat_.empty()) {
    spdlog::info(
        "going on from scan {}: {} scans were recorded since the last checkpoint and "
        "are mapped again",
        next_, to_repeat_.size());
  }
  log_ = std::make_unique<SessionLog>(folder_.Path("session.db"), hooks_.on_durable);
  checkpoints_ =
      std::make_unique<CheckpointWriting>(folder_, setup_.fixed_options, mapping_.get(), stores,
                                          log_.get(), next_, hooks_.on_checkpoint);
  trajectory_ = std::make_unique<TrajectoryPublisher>(folder_, mapping_.get(), log_.get());
}

MappingCallbacks Session::Callbacks() {
  MappingCallbacks callbacks;
  callbacks.on_scan = [this](const MappedScan& report) { OnScan(report); };
  callbacks.on_scan_done = [this] { OnScanDone(); };
  callbacks.on_final_pose = [this](const FinalPose& pose) {
    if (finished_) {
      tail_.push_back(pose);
    } else {
      log_->Finalise({static_cast<std::int64_t>(pose.scan), pose.pose.T_world_lidar, pose.skipped,
                      pose.given_up});
    }
    if (hooks_.on_final) hooks_.on_final(pose);
  };
  callbacks.on_look = [this](const PlaceReport& report) {
    if (hooks_.on_look) hooks_.on_look(report);
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
  ScanRecord row = RecordOf(report);
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
    if (HasChanged(report)) {
      spdlog::error(
          "{}: is another file than the one of that name that was mapped before; the scans from it "
          "on are mapped anew with what it holds",
          file.name);
    }
    if (hooks_.on_mapped) hooks_.on_mapped(report, row);
    log_->Put(row);
  }
  ++next_;
  if (hooks_.on_scan) hooks_.on_scan(report, row);
}

void Session::OnScanDone() {
  ReportDamage();
  // Not before: what a scan leads to after it was told of belongs to it, and to its checkpoint.
  tiles_->SetScan(next_);
  checkpoints_->AfterScan(next_, setup_.session.checkpoint_every_scans);
  // Not while scans are repeated: the files hold these, and would lose the last of them for a time.
  if (!Repeating()) trajectory_->PublishIfDue(next_, setup_.session.trajectory_period_s);
}

bool Session::Repeating() const {
  return next_ < repeat_from_ + static_cast<std::int64_t>(to_repeat_.size());
}

const ScanRecord* Session::Recorded() const {
  const auto i = static_cast<std::size_t>(next_ - repeat_from_);
  return i < to_repeat_.size() ? &to_repeat_[i] : nullptr;
}

// Whether a scan that is repeated could be read the first time, and cannot now.
bool Session::FileIsGone(const MappedScan& report) const {
  const ScanRecord* const before = Recorded();
  return before != nullptr && !before->skipped && report.skipped &&
         report.reason == SkipReason::kUnreadable;
}

// Whether a scan that is repeated has other points than the first time: the same file gives the
// same.
bool Session::HasChanged(const MappedScan& report) const {
  const ScanRecord* const before = Recorded();
  return before != nullptr && !before->skipped && !report.skipped &&
         before->points != static_cast<std::int64_t>(report.points);
}

void Session::ReportDamage() {
  const std::size_t damaged =
      tiles_->damaged() + (submaps_ != nullptr ? submaps_->damaged() : std::size_t{0});
  if (damaged == damaged_) return;
  damaged_ = damaged;
  spdlog::error("{}: {} records of the map on disk are damaged: what they held is missing from it",
                setup_.folder, damaged);
}

void Session::SetAside(const std::string& file, const std::string& reason) {
  log_->SetAside(file, reason);
}

bool Session::Idle() {
  const bool more = checkpoints_->Idle(next_);
  if (!Repeating()) trajectory_->PublishIfDue(next_, setup_.session.trajectory_period_s);
  return more;
}

void Session::WaitForHousekeeping() {
  checkpoints_->Wait();
  trajectory_->Wait();
}

void Session::Finish() {
  checkpoints_->Complete(next_);
  log_->WaitDurable();
  WaitForHousekeeping();
  if (checkpoints_->newest() != next_) {
    const std::string text =
        fmt::format("{}: the last checkpoint could not be written; {} scans will be mapped again",
                    setup_.folder, next_ - checkpoints_->newest());
    if (FreeBytes(setup_.folder) < RoomToContinue(setup_.folder)) throw DiskFullError(text);
    throw OutputError(text);
  }
  ReportDamage();
  if (Repeating()) return;
  finished_ = true;
  tail_.clear();
  mapping_->Finish();
  trajectory_->PublishLast(*database_, next_, tail_);
}

void Session::ForEachPose(const FinalPoses::Visit& visit) const {
  log_->WaitDurable();
  const std::int64_t open = tail_.empty() ? next_ : static_cast<std::int64_t>(tail_.front().scan);
  database_->ForEach(0, open, [&](const ScanRecord& scan) { visit(PoseOf(scan)); });
  for (const FinalPose& pose : tail_) visit(AsRecorded(*database_, pose));
}

}  // namespace lamina
