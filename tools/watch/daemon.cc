#include "tools/watch/daemon.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <utility>

#include "core/base/error.h"
#include "tools/cli/common.h"
#include "tools/results/verdict/process_report.h"
#include "tools/run/opening_choice.h"
#include "tools/watch/continued.h"
#include "tools/watch/log.h"
#include "tools/watch/service_notify.h"
#include "tools/watch/session_results.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

using SystemClock = std::chrono::system_clock;
using SteadyClock = std::chrono::steady_clock;

// Scans handed to the session at once: between two batches the inbox is looked at.
constexpr std::size_t kBatch = 64;

double Milliseconds(std::chrono::nanoseconds d) { return 1e-6 * static_cast<double>(d.count()); }

// When a file was last written or renamed.
SystemClock::time_point LastChange(const std::string& path) {
  struct stat status = {};
  if (stat(path.c_str(), &status) != 0) return SystemClock::now();
  return SystemClock::time_point(std::chrono::duration_cast<SystemClock::duration>(
      std::chrono::seconds(status.st_ctim.tv_sec) +
      std::chrono::nanoseconds(status.st_ctim.tv_nsec)));
}

// Scans of a recording in one file are decoded for their stamps, too: so many stay unpacked.
constexpr std::size_t kBatchOfRecording = 8;

}  // namespace

WatchDaemon::WatchDaemon(WatchSetup setup)
    : setup_(std::move(setup)),
      files_(setup_.inbox, setup_.session, setup_.done),
      undecided_(setup_.session, files_, setup_.done),
      room_(setup_.session),
      opening_check_(setup_.config.scans),
      queries_([this] { Wake(); }),
      verdict_(setup_.config.frontend.matcher.max_iterations) {
  // Made anew for want of room, it may have decided before.
  if (!undecided_.Is()) setup_.shipped = nullptr;
  if (setup_.shipped) undecided_.Begin();
  session_ = std::make_unique<Session>(MakeSessionSetup(), Hooks());
  WriteTextFile((fs::path(setup_.session) / "config.yaml").string(), ToYaml(setup_.config));
  if (!setup_.shipped) undecided_.Decide();
  OpenInbox();
  if (!setup_.http) return;
  session_->TrackTiles();
  session_->database().ForEach(0, session_->next_scan(), [this](const ScanRecord& row) {
    verdict_.Add(row);
    if (!row.skipped) view_.AddPast({row.scan, row.stamp_ns, row.T_world_lidar, row.piece});
  });
  HttpParts parts;
  parts.view = &view_;
  parts.map = [this](const MapQuery& query) { return queries_.Ask(query); };
  parts.checkpoint = [this] {
    checkpoint_wanted_ = true;
    Wake();
  };
  parts.stop = [this] {
    // To the process: the threads of the server let no signal through.
    kill(getpid(), SIGTERM);
    Wake();
  };
  parts.session = setup_.session;
  server_ = std::make_unique<HttpServer>(*setup_.http, std::move(parts));
  spdlog::info("live page at {}", server_->url());
}

WatchDaemon::~WatchDaemon() {
  server_.reset();
  // What it still does on its threads uses the rest.
  session_.reset();
}

SessionSetup WatchDaemon::MakeSessionSetup() const {
  SessionSetup setup;
  setup.folder = setup_.session;
  setup.mapping = setup_.config.Mapping();
  setup.fixed_options = ResultOptionsToYaml(setup_.config);
  setup.session = setup_.config.session;
  setup.base_map = setup_.base_map;
  setup.has_file = [this](const ScanRecord& scan) { return files_.Has(scan); };
  if (setup_.base_map) {
    setup.base_map->fixed_options = OptionsOfMap();
    std::string start = "none";
    if (const std::optional<SE3>& T = setup_.base_map->T_world_start) {
      start = fmt::format("{} {} {} {} {} {} {}", T->t.x(), T->t.y(), T->t.z(), T->q.x(), T->q.y(),
                          T->q.z(), T->q.w());
    }
    setup.fixed_options +=
        fmt::format("localise:\n  map: {}\n  start: {}\n", setup_.base_map->session, start);
  }
  return setup;
}

// Those that the map must have been made with: how its scans were prepared is its own affair.
std::string WatchDaemon::OptionsOfMap() const {
  LaminaConfig config = setup_.config;
  const fs::path of_map = fs::path(setup_.base_map->session) / "config.yaml";
  if (fs::exists(of_map)) config.preparation = LoadConfig(of_map.string(), {}).preparation;
  return ResultOptionsToYaml(config);
}

SessionHooks WatchDaemon::Hooks() {
  SessionHooks hooks;
  hooks.on_mapped = [this](const MappedScan& report, const ScanRecord&) { OnMapped(report); };
  hooks.on_scan = [this](const MappedScan& report, const ScanRecord& row) { OnScan(report, row); };
  hooks.on_final = [this](const FinalPose& pose) {
    if (setup_.http) ShowFinalPose(pose);
  };
  hooks.on_look = [](const PlaceReport& report) { LogLook(report); };
  hooks.on_durable = [this](const ScanRecord& row) { OnDurable(row); };
  hooks.on_checkpoint = [this](const SessionCheckpoint& checkpoint, std::int64_t released) {
    OnCheckpoint(checkpoint, released);
  };
  return hooks;
}

void WatchDaemon::OpenInbox() {
  const SessionDatabase& database = session_->database();
  inbox_ = std::make_unique<Inbox>(
      setup_.inbox, setup_.config.scans, setup_.config.inbox,
      [&database](const std::string& name) { return database.Knows(name); });
  if (!inbox_->polls().empty()) spdlog::info("the inbox is polled: {}", inbox_->polls());
  late_ = ContinueInbox(database, inbox_.get());
  scans_ = ContinueScans(database, session_->next_scan(), setup_.config.scans);
}

RunVerdict WatchDaemon::Run(const std::atomic<bool>& stop) {
  NotifyService("READY=1");
  ShowStatus(LiveState::kStarting);
  RepeatOpening(stop);
  if (fitting_) return {};
  Repeat(stop);
  if (setup_.once) inbox_->Drain();
  while (!stop) {
    if (reload_.exchange(false)) Reload();
    if (checkpoint_wanted_.exchange(false)) session_->RequestCheckpoint();
    if (!room_.Enough()) {
      Rest(LiveState::kIdle);
      continue;
    }
    TakeNotices();
    const bool mapped = MapWaiting(stop);
    if (fitting_) return {};
    if (mapped) continue;
    if (setup_.once && !inbox_->opening()) {
      // Fewer scans than tell else.
      if (setup_.shipped && scans_->size() > 0) DecideOpening(stop);
      if (fitting_) return {};
      break;
    }
    Rest(LiveState::kIdle);
  }
  // What the last look at the inbox refused.
  TakeNotices();
  NotifyService("STOPPING=1");
  ShowStatus(LiveState::kStopping);
  session_->Finish();
  if (session_->Repeating()) {
    spdlog::info(
        "scans that were recorded are still to be mapped again: the files stay as they are");
    return {};
  }
  return WriteOutputs();
}

// Scans that were recorded after the checkpoint that was loaded, from their files as they are now.
void WatchDaemon::Repeat(const std::atomic<bool>& stop) {
  const std::vector<ScanRecord>& rows = session_->to_repeat();
  RepeatedFiles files(files_, setup_.config.scans);
  for (std::size_t i = 0; i < rows.size() && !stop;) {
    if (!room_.Enough()) {
      Rest(LiveState::kStarting);
      continue;
    }
    const std::size_t begin = i;
    for (const std::size_t end = std::min(rows.size(), i + kBatch); i < end; ++i) {
      if (!files.Ready(rows[i])) break;
      scans_->Append(files.FileOf(rows[i]));
    }
    if (i > begin) {
      session_->Process(scans_.get(), &stop);
      continue;
    }
    ShowStatus(LiveState::kStarting);
    NotifyWatchdog();
    SleepFor(std::chrono::milliseconds(5));
  }
}

// What there is to do while nothing is mapped, and a wait for what may come.
void WatchDaemon::Rest(LiveState state) {
  const bool asked =
      queries_.AnswerSlice(session_->mapping().map(), setup_.config.backend.min_surfel_frames);
  ShowOpenPoses();
  ShowStatus(state);
  NotifyWatchdog();
  // Pieces of a checkpoint follow one another as fast as they are written.
  const bool busy = session_->Idle() || asked;
  // Files that wait for room would end any wait of the inbox's.
  if (!room_.wanted().empty()) return SleepFor(std::chrono::milliseconds(busy ? 5 : 200));
  inbox_->Wait(std::chrono::milliseconds(asked ? 0 : busy ? 5 : 1000));
}

void WatchDaemon::TakeNotices() {
  for (const InboxNotice& notice : inbox_->TakeLate()) {
    ++late_;
    spdlog::warn("{}: set aside: {}", notice.name, notice.reason);
    session_->SetAside(notice.name, notice.reason);
    session_->DoLater([this, notice] { files_.Reject(notice.name, notice.reason); });
  }
  for (const InboxNotice& notice : inbox_->TakeRefused()) {
    ++rejected_;
    spdlog::warn("{}: refused: {}", notice.name, notice.reason);
    session_->DoLater([this, notice] { files_.NoteReason(notice.name, notice.reason); });
  }
}

// Maps what is ready. The inbox holds the rest back: it is the queue.
bool WatchDaemon::MapWaiting(const std::atomic<bool>& stop) {
  std::size_t taken = 0;
  while (taken < kBatch) {
    std::optional<InboxFile> file = inbox_->Next();
    if (!file) break;
    const bool of_recording = file->recording != nullptr;
    opening_check_.Add(scans_->size(), *file);
    scans_->Append(std::move(*file));
    ++taken;
    if (opening_check_.due()) CheckOpening(stop);
    if (fitting_) return true;
    if (of_recording && taken >= kBatchOfRecording) break;
  }
  if (taken > 0) session_->Process(scans_.get(), &stop);
  // Its scans are recorded by now. So it is not opened again after a restart.
  for (const InboxNotice& notice : inbox_->TakeEnded()) {
    if (stop) break;
    spdlog::info("{}: {}", notice.name, notice.reason);
    session_->SetAside(notice.name, notice.reason);
  }
  return taken > 0;
}

void WatchDaemon::CheckOpening(const std::atomic<bool>& stop) {
  NotifyWatchdog();
  if (!setup_.shipped || !DecideOpening(stop)) {
    for (const std::string& warning : opening_check_.Look(files_, setup_.config.Mapping(), stop))
      spdlog::warn("{}", warning);
  }
  NotifyWatchdog();
}

// The first scans of a session that went on before they had decided.
void WatchDaemon::RepeatOpening(const std::atomic<bool>& stop) {
  if (!setup_.shipped) return;
  const SessionDatabase& database = session_->database();
  std::vector<ScanRecord> rows;
  database.ForEach(0, database.scans(), [&](const ScanRecord& row) { rows.push_back(row); });
  RepeatedFiles files(files_, setup_.config.scans);
  for (std::size_t i = 0; i < rows.size() && !stop && !opening_check_.due();) {
    if (!files.Ready(rows[i])) {
      NotifyWatchdog();
      SleepFor(std::chrono::milliseconds(5));
      continue;
    }
    opening_check_.Add(i, files.FileOf(rows[i]));
    ++i;
  }
  if (opening_check_.due()) CheckOpening(stop);
}

// False where the stretch is still to be looked at.
bool WatchDaemon::DecideOpening(const std::atomic<bool>& stop) {
  const StreamedScans scans = opening_check_.Stretch(files_);
  const OpeningChoice choice =
      ChooseOpening(scans, {0, scans.size()}, setup_.config, setup_.shipped, stop);
  if (stop) return false;
  const bool as_it_is = ResultOptionsToYaml(choice.config) == ResultOptionsToYaml(setup_.config);
  if (as_it_is || !undecided_.MayBeginAnew()) {
    undecided_.Decide();
    setup_.shipped = nullptr;
    if (as_it_is) opening_check_.Settle(choice.deskew, choice.sweep);
    return as_it_is;
  }
  if (choice.fit.measured) spdlog::warn("{}: --config {}", choice.fit.reason, choice.fit.name);
  for (const std::string& warning : choice.Warnings()) spdlog::warn("{}", warning);
  spdlog::info("the session begins anew with that, from its first scan on");
  fitting_ = choice.config;
  return true;
}

void WatchDaemon::OnMapped(const MappedScan& report) {
  // What lay there before is late for reasons of its own.
  const auto complete = std::max(start_on_clock_, LastChange(scans_->File(report.index).path));
  const std::lock_guard<std::mutex> lock(mutex_);
  under_way_.push_back({SteadyClock::now(), complete});
}

void WatchDaemon::WarnRepeated(const std::string& kind, const std::string& line) {
  if (const auto shown = repeated_.Next(kind, line)) spdlog::warn("{}", *shown);
}

void WatchDaemon::OnScan(const MappedScan& report, const ScanRecord& row) {
  if (report.began_piece && report.piece > 0) spdlog::warn(NewPieceMessage(report));
  if (report.skipped) {
    ++rejected_;
    WarnRepeated("skipped: " + row.status,
                 fmt::format("skipped scan {}: {}", row.scan, row.detail));
    const bool of_recording = scans_->File(report.index).recording != nullptr;
    session_->DoLater([this, row, of_recording] {
      if (of_recording) return files_.NoteReason(row.file, row.detail);
      files_.Reject(row.file, row.detail);
    });
  } else if (report.odometry.status == OdometryFrame::Status::kLost) {
    WarnRepeated("lost", fmt::format("lost at scan {}: {:.0f} % of its clusters agree with the map",
                                     row.scan, 100.0 * row.inlier_share));
  }
  verdict_.Add(row);
  if (!report.skipped) T_map_world_ = report.T_map_world;
  degenerate_directions_ = report.skipped ? 0 : report.odometry.match.degenerate;
  map_peak_bytes_ = std::max(map_peak_bytes_, session_->mapping().map().bytes());
  queries_.AnswerSlice(session_->mapping().map(), setup_.config.backend.min_surfel_frames);
  ShowScan(report);
  ShowStatus(setup_.base_map ? LiveState::kLocalising : LiveState::kMapping);
  NotifyWatchdog();
}

// On the log's thread.
void WatchDaemon::OnDurable(const ScanRecord& row) {
  UnderWay under_way;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    under_way = under_way_.front();
    under_way_.pop_front();
  }
  if (row.skipped) return;
  StageTimes times;
  times.lag_ms =
      static_cast<float>(std::max(0.0, Milliseconds(SystemClock::now() - under_way.complete)));
  times.read_ms = static_cast<float>(row.read_ms);
  times.prepare_ms = static_cast<float>(row.prepare_ms);
  times.cluster_ms = static_cast<float>(row.cluster_ms);
  times.odometry_ms = static_cast<float>(row.odometry_ms);
  times.map_ms = static_cast<float>(row.map_ms);
  times.solve_ms = static_cast<float>(row.solve_ms);
  times.durable_ms = static_cast<float>(Milliseconds(SteadyClock::now() - under_way.mapped));
  view_.AddFrame({{row.scan, row.stamp_ns, row.T_world_lidar, row.piece}, times});
}

// On the housekeeping thread.
void WatchDaemon::OnCheckpoint(const SessionCheckpoint& done, std::int64_t released) {
  spdlog::info(
      "checkpoint after scan {}: {:.1f} MB in {:.0f} ms, the mapping paused for {:.1f} ms "
      "at most",
      done.scans - 1, static_cast<double>(done.bytes) / 1048576.0, done.total_ms,
      done.longest_pause_ms);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    checkpoint_ = LiveStatus::Checkpoint{done.scans - 1, static_cast<std::size_t>(done.bytes),
                                         done.total_ms, SteadyClock::now()};
  }
  SessionDatabase database((fs::path(setup_.session) / "session.db").string(), false);
  const std::int64_t from = FilesDoneUpTo(database);
  if (released <= from) return;
  SetFilesDoneUpTo(files_.Release(database, from, released), &database);
}

void WatchDaemon::Reload() {
  NotifyService("RELOADING=1");
  try {
    const LaminaConfig config = setup_.reload();
    if (ResultOptionsToYaml(config) != ResultOptionsToYaml(setup_.config)) {
      spdlog::warn(
          "options that decide results have changed: a session keeps those that it was "
          "begun with");
    }
    setup_.config.session = config.session;
    setup_.config.log.level = config.log.level;
    session_->SetOptions(config.session);
    spdlog::set_level(LogLevel(config.log));
    spdlog::info("configuration read again: session.* and log.level hold from now on");
  } catch (const std::exception& error) {
    spdlog::error("the configuration stays as it was: {}", error.what());
  }
  NotifyService("READY=1");
}

RunVerdict WatchDaemon::WriteOutputs() {
  RunFigures figures;
  figures.wall_s = 1e-3 * Milliseconds(SteadyClock::now() - start_);
  figures.cpu_s = ProcessCpuSeconds();
  figures.map_peak_bytes = map_peak_bytes_;
  return WriteSessionResults(setup_.session, setup_.config, figures, late_, session_.get());
}

}  // namespace lamina
