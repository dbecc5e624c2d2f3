// `lamina watch`: an inbox in, a session out, for as long as it is let run.
//
//     inbox -> Session (pipeline, database, checkpoints) -> files of the session
//                 \-> LiveView -> HTTP
//
// Everything happens on the thread that calls Run(), but for what Session and HttpServer do on
// theirs.
#pragma once

#include <atomic>
#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "backend/session/session.h"
#include "config/config.h"
#include "io/inbox/inbox.h"
#include "tools/cli/repeated_lines.h"
#include "tools/run/opening_choice.h"
#include "tools/watch/files.h"
#include "tools/watch/live/map_queries.h"
#include "tools/watch/live/server.h"
#include "tools/watch/live/view.h"
#include "tools/watch/opening_check.h"
#include "tools/watch/room.h"
#include "tools/watch/undecided_session.h"

namespace lamina {

struct WatchSetup {
  std::string inbox, session;
  LaminaConfig config;
  std::optional<HttpAddress> http;
  DonePolicy done = DonePolicy::kKeep;
  bool once = false;  // map what is there, then end
  std::optional<BaseMap> base_map;
  // Reads the configuration again; for SIGHUP.
  std::function<LaminaConfig()> reload;
  // Of a session whose first scans decide (undecided_session.h); else empty.
  ShippedConfig shipped;
};

class WatchDaemon {
 public:
  // Opens session and inbox, starts to serve. Throws InputError, OptionError, OutputError.
  explicit WatchDaemon(WatchSetup setup);
  ~WatchDaemon();

  // Until `stop` is true (or all is mapped, if once). Then the session has its files; returns what
  // they say of its poses. While its disk has no room left it waits. Throws OutputError when the
  // session cannot be written any more: DiskFullError if the disk was full all the same.
  RunVerdict Run(const std::atomic<bool>& stop);

  // What the session is to begin anew with, if Run() has ended for that. It must be cleared then.
  const std::optional<LaminaConfig>& fitting() const { return fitting_; }

  // Safe in a signal handler. Ends a wait for scans.
  void Wake() noexcept { inbox_->Interrupt(); }
  void RequestReload() noexcept { reload_ = true; }

 private:
  // A scan that is mapped and not durable yet; they become so in order.
  struct UnderWay {
    std::chrono::steady_clock::time_point mapped;
    std::chrono::system_clock::time_point complete;
  };

  SessionSetup MakeSessionSetup() const;
  std::string OptionsOfMap() const;
  SessionHooks Hooks();
  void OpenInbox();
  void Repeat(const std::atomic<bool>& stop);
  void Rest(LiveState state);
  void TakeNotices();
  bool MapWaiting(const std::atomic<bool>& stop);
  void CheckOpening(const std::atomic<bool>& stop);
  void RepeatOpening(const std::atomic<bool>& stop);
  bool DecideOpening(const std::atomic<bool>& stop);
  void OnMapped(const MappedScan& report);
  void OnScan(const MappedScan& report, const ScanRecord& row);
  void WarnRepeated(const std::string& kind, const std::string& line);
  void OnDurable(const ScanRecord& row);
  void OnCheckpoint(const SessionCheckpoint& checkpoint, std::int64_t released);
  void ShowStatus(LiveState state);
  void ShowFinalPose(const FinalPose& pose);
  void ShowOpenPoses();
  void ShowScan(const MappedScan& report);
  void Reload();
  RunVerdict WriteOutputs();

  WatchSetup setup_;
  WatchFiles files_;
  UndecidedSession undecided_;
  std::optional<LaminaConfig> fitting_;
  WatchRoom room_;
  LiveView view_;
  std::unique_ptr<Session> session_;
  std::unique_ptr<Inbox> inbox_;
  std::unique_ptr<StreamedScans> scans_;
  OpeningCheck opening_check_;
  MapQueries queries_;
  std::atomic<bool> reload_{false}, checkpoint_wanted_{false};

  std::mutex mutex_;  // guards the two that follow
  std::deque<UnderWay> under_way_;
  std::optional<LiveStatus::Checkpoint> checkpoint_;

  VerdictCounter verdict_;  // on the scans of the live page
  std::size_t rejected_ = 0, late_ = 0;
  RepeatedLines repeated_;
  int degenerate_directions_ = 0;
  SE3 T_map_world_;  // of the newest scan
  std::size_t map_peak_bytes_ = 0;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::chrono::system_clock::time_point start_on_clock_ = std::chrono::system_clock::now();
  std::unique_ptr<HttpServer> server_;  // ends first
};

}  // namespace lamina
