#include "tools/watch/command.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "io/file/disk_room.h"
#include "io/points/scan_file.h"
#include "tools/cli/common.h"
#include "tools/cli/options.h"
#include "tools/results/output_folder.h"
#include "tools/results/verdict/process_report.h"
#include "tools/watch/daemon.h"
#include "tools/watch/log.h"
#include "tools/watch/room.h"
#include "tools/watch/steady_heap.h"

namespace lamina {
namespace {

struct WatchArguments {
  std::string inbox, session, map;
  std::string mode = "map", http = "127.0.0.1:8090", done = "keep";
  ConfigArguments config;
  std::vector<double> start;
  bool once = false;
  int threads = 0;
};

// The daemon that signals are for.
std::atomic<WatchDaemon*> running_daemon{nullptr};

void RequestReload(int) {
  WatchDaemon* const daemon = running_daemon;
  if (daemon == nullptr) return;
  daemon->RequestReload();
  daemon->Wake();
}

// x y z, or x y z qx qy qz qw; nothing of nothing.
std::optional<SE3> ParseStart(const std::vector<double>& numbers) {
  if (numbers.empty()) return std::nullopt;
  if (numbers.size() != 3 && numbers.size() != 7) {
    throw OptionError(
        fmt::format("--start has {} numbers: must be x y z or x y z qx qy qz qw", numbers.size()));
  }
  for (const double number : numbers) {
    if (!std::isfinite(number))
      throw OptionError(fmt::format("--start: {} must be a finite number", number));
  }
  SE3 T;
  T.t = {numbers[0], numbers[1], numbers[2]};
  if (numbers.size() == 7) {
    const Eigen::Quaterniond q(numbers[6], numbers[3], numbers[4], numbers[5]);
    if (!(std::abs(q.norm() - 1.0) <= 1e-3)) {
      throw OptionError(fmt::format("--start: the quaternion has norm {}, must be 1", q.norm()));
    }
    T = SE3(q, T.t);
  }
  return T;
}

// Files that a session moves or rejects must not come back through its inbox.
void CheckFolders(const std::string& inbox, const std::string& session) {
  namespace fs = std::filesystem;
  if (!fs::is_directory(inbox)) {
    throw InputError(fmt::format("{}: the inbox must be a folder", inbox));
  }
  if (IsWithin(session, inbox)) {
    throw OptionError(
        fmt::format("--session {}: must be outside of the inbox, {}", session, inbox));
  }
  if (HoldsResults(session)) {
    throw OptionError(fmt::format(
        "--session {}: holds results of `lamina run`, which would be replaced", session));
  }
}

// The configuration that is named, or else that of the session that is continued, or of the map to
// localise in: what decides results must be as it was then.
std::string ConfigOf(const WatchArguments& a) {
  if (!a.config.file.empty()) return a.config.file;
  for (const std::string& session : {a.session, a.map}) {
    const std::string own = (std::filesystem::path(session) / "config.yaml").string();
    if (session.empty() || !IsSession(session) || !std::filesystem::exists(own)) continue;
    fmt::print(stderr, "options of the session {} hold: {}\n", session, own);
    return own;
  }
  return "";
}

UndecidedSession UndecidedOf(const WatchSetup& setup) {
  return {setup.session, WatchFiles(setup.inbox, setup.session, setup.done), setup.done};
}

// Nothing if the session is to begin anew, as `setup` says then.
std::optional<RunVerdict> RunOnce(WatchSetup* setup, const std::atomic<bool>& stop) {
  std::optional<LaminaConfig> fitting;
  {
    WatchDaemon daemon(*setup);
    const auto forget = [](WatchDaemon*) { running_daemon = nullptr; };
    const std::unique_ptr<WatchDaemon, decltype(forget)> running(&daemon, forget);
    running_daemon = &daemon;
    const RunVerdict verdict = daemon.Run(stop);
    fitting = daemon.fitting();
    if (!fitting) return verdict;
  }
  UndecidedOf(*setup).Clear();
  setup->config = *fitting;
  setup->shipped = nullptr;
  return std::nullopt;
}

// Makes a daemon and runs it, anew when its first scans have decided how, and whenever its disk was
// full and has room again.
RunVerdict RunDaemon(WatchSetup setup, const std::atomic<bool>& stop) {
  // Room may be there for a moment, again and again, too little to get on with.
  constexpr std::chrono::seconds kFirstWait{1}, kLongestWait{60};
  bool last = false;
  for (std::chrono::seconds wait = kFirstWait;; wait = std::min(2 * wait, kLongestWait)) {
    try {
      if (const auto verdict = RunOnce(&setup, stop)) return *verdict;
      wait = kFirstWait;
    } catch (const DiskFullError& error) {
      spdlog::error("{}", error.what());
      if (last || !WaitForRoom(setup.session, wait, stop)) throw;
      // A signal that came while it waited ends a session as any other does, where there is room.
      last = stop;
    }
  }
}

int Watch(const WatchArguments& a) {
  KeepHeapSteady();
  WatchSetup setup;
  setup.inbox = a.inbox;
  setup.session = a.session;
  setup.http = ParseHttpAddress(a.http);
  setup.done = ParseDonePolicy(a.done);
  setup.once = a.once;
  CheckFolders(a.inbox, a.session);
  const bool undecided = a.config.file.empty() && a.mode == "map" && UndecidedOf(setup).Is();
  const std::string config = ConfigOf(a);
  setup.config = LoadConfig(config, a.config.set);
  setup.reload = [&a] { return LoadConfig(ConfigOf(a), a.config.set); };
  if (undecided)
    setup.shipped = [&a](const std::string& name) { return LoadConfig(name, a.config.set); };
  if (a.mode == "localise") {
    if (a.map.empty()) throw OptionError("--mode localise needs --map SESSION");
    setup.base_map = BaseMap{a.map, "", ParseStart(a.start)};
    // Before anything is written: what a session was begun with stays.
    if (!IsSession(a.map))
      throw InputError(fmt::format(
          "--map {}: holds no map to localise in; that is the session of a `lamina watch`", a.map));
  } else if (!a.map.empty() || !a.start.empty()) {
    throw OptionError("--map and --start are for --mode localise");
  }
  const auto limit = LimitThreads(a.threads);
  MakeDirectory(a.session);
  SetUpWatchLog(setup.config.log, a.session);
  const std::atomic<bool>& stop = StopOnSignals();
  std::signal(SIGHUP, RequestReload);
  // The reader of the log may go, and the stream goes on.
  std::signal(SIGPIPE, SIG_IGN);
  const RunVerdict verdict = RunDaemon(setup, stop);
  PrintOutputs(a.session);
  // Without an end of its own, to be interrupted is how it ends.
  if (a.once && StopSignal() == SIGINT) {
    throw InterruptedError("the session goes on from there when it is started again");
  }
  return a.once && verdict.grade == RunVerdict::Grade::kWrong ? kProbablyWrong : 0;
}

void AddMappingOptions(CLI::App* command, WatchArguments* a) {
  AddConfigOptions(command, "; read again on SIGHUP (session.*, log.level)", &a->config);
  AddTopicOption(command, &a->config);
  AddThreadsOption(command, "", &a->threads);
  command
      ->add_option("--mode", a->mode,
                   "map: make a map; localise: find the scans in a finished map, which stays as "
                   "it is")
      ->check(CLI::IsMember({"map", "localise"}))
      ->capture_default_str();
  command->add_option("--map", a->map, "For --mode localise: the session that has the map");
  command
      ->add_option("--start", a->start,
                   "For --mode localise: where the first scan is in the map, roughly: x y z, or "
                   "x y z qx qy qz qw. Without it the sensor is looked for everywhere in the map")
      ->expected(3, 7);
}

}  // namespace

void AddWatchCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<WatchArguments>();
  WatchArguments& a = *arguments;
  CLI::App* command = app->add_subcommand(
      "watch", "Map point files as they arrive in a folder, for days, and never lose what is done");
  command
      ->add_option("--inbox", a.inbox,
                   "Folder into which files come: " + FolderPatterns() +
                       ", in it or in subfolders, one for each sequence, in the layouts that `run` "
                       "knows; or .bag, .mcap, .pcap, .pcapng and ROS 2 bags, each a recording of "
                       "its own")
      ->required();
  command
      ->add_option("--session", a.session,
                   "Folder of the session; made if it is not there, continued if it is")
      ->required();
  AddMappingOptions(command, &a);
  command
      ->add_option("--http", a.http,
                   "HOST:PORT of the live page and the API, or off. The token for POST is in "
                   "SESSION/token")
      ->capture_default_str();
  command
      ->add_option("--done", a.done,
                   "What becomes of a file once nothing can need it again: keep it in the inbox, "
                   "move it to SESSION/done, or delete it")
      ->check(CLI::IsMember({"keep", "move", "delete"}))
      ->capture_default_str();
  command->add_flag("--once", a.once, "Map what the inbox holds, then end as `run` does");
  command->callback([arguments, run] { *run = [arguments] { return Watch(*arguments); }; });
}

}  // namespace lamina
