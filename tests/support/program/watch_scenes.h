// Runs `lamina watch` as a child process: an inbox "in" and a session "session" in the test's
// folder.
#pragma once

#include <fmt/format.h>
#include <poll.h>
#include <sys/inotify.h>
#include <sys/syscall.h>

#include <chrono>
#include <csignal>
#include <map>

#include "io/store/session_database.h"
#include "tests/support/program/run_helpers.h"

namespace lamina {

// Can be polled for the end of a process.
inline int ProcessHandle(pid_t process) {
  return static_cast<int>(syscall(SYS_pidfd_open, process, 0));
}

class WatchTest : public RunTest {
 protected:
  using Arguments = std::vector<std::string>;

  WatchTest() { std::filesystem::create_directories(Path("in/velodyne")); }
  ~WatchTest() override {
    for (const pid_t child : children_) {
      if (!IsRunning(child)) continue;
      kill(child, SIGKILL);
      waitpid(child, nullptr, 0);
    }
  }

  pid_t StartWatch(const Arguments& more = {}, const std::string& session = "session") {
    Arguments arguments{"watch", "--inbox", Path("in"), "--session", Path(session)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    if (std::find(more.begin(), more.end(), "--http") == more.end()) {
      arguments.insert(arguments.end(), {"--http", "off"});
    }
    children_.push_back(Start(arguments));
    return children_.back();
  }

  // Maps what the inbox holds. Fails the test unless that exits with `code`.
  Outcome Once(Arguments more = {}, int code = 0, const std::string& session = "session") {
    more.emplace_back("--once");
    Outcome outcome = WaitFor(StartWatch(more, session));
    EXPECT_EQ(outcome.code, code) << outcome.err;
    return outcome;
  }

  // Ends a daemon in order.
  Outcome Terminate(pid_t child) {
    EXPECT_EQ(kill(child, SIGTERM), 0);
    Outcome outcome = WaitFor(child);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return outcome;
  }

  // Until `condition` holds. False, and what the child has said, if it ends or all patience does.
  testing::AssertionResult WaitUntil(pid_t child, const std::function<bool()>& condition) const {
    const int handle = ProcessHandle(child);
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(120);
    bool holds = condition();
    for (bool ended = false; !holds && !ended;) {
      pollfd end{handle, POLLIN, 0};
      ended = poll(&end, 1, 5) != 0 || std::chrono::steady_clock::now() > deadline;
      holds = condition();
    }
    if (handle >= 0) close(handle);
    if (holds) return testing::AssertionSuccess();
    return testing::AssertionFailure() << "waited in vain; it said: " << Bytes(Path("stderr"));
  }

  bool Said(const std::string& text) const {
    return Bytes(Path("stderr")).find(text) != std::string::npos;
  }
  // Until so many scans are durable.
  testing::AssertionResult WaitForScans(pid_t child, std::int64_t count,
                                        const std::string& session = "session") const {
    return WaitUntil(child, [&] {
      // Written once the database is there.
      if (!std::filesystem::exists(Path(session + "/config.yaml"))) return false;
      return SessionDatabase(Path(session + "/session.db"), false).scans() >= count;
    });
  }

  // A file appears in the inbox at once and whole.
  void Drop(const std::string& name, const std::string& bytes) const {
    const std::string partial = Write("in/" + name + ".partial", bytes);
    std::filesystem::rename(partial, Path("in/" + name));
  }
  // Scans [from, to) of a recording, in KITTI's layout, each with its stamp.
  void DropScans(const Recording& recording, std::size_t from, std::size_t to,
                 const std::string& folder = "") const {
    for (std::size_t i = from; i < to; ++i) {
      std::filesystem::create_directories(Path("in/" + folder));
      std::ofstream(Path("in/" + folder + "times.txt"), std::ios::app)
          << fmt::format("{:.9f}\n", recording[i].stamp_s);
      Drop(folder + "velodyne/" + ScanName(i), recording[i].bytes);
    }
  }

  // Names of all files in a folder and those below it, relative to it.
  std::vector<std::string> FilesIn(const std::string& folder) const {
    std::vector<std::string> names;
    if (!std::filesystem::exists(Path(folder))) return names;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(Path(folder))) {
      if (entry.is_directory()) continue;
      names.push_back(entry.path().lexically_relative(Path(folder)).string());
    }
    std::sort(names.begin(), names.end());
    return names;
  }

  // A line of frames.csv without what it took of time.
  static std::string WithoutTimes(std::string line) {
    for (int i = 0; i < 6; ++i) line.erase(std::min(line.size(), line.rfind(',')));
    return line;
  }

  void ExpectSameResults(const std::string& session, const std::string& run) const {
    for (const char* name : {"trajectory_kitti.txt", "trajectory_tum.txt", "map_surfels.ply"}) {
      const std::string file = std::string("/") + name;
      EXPECT_NE(Bytes(Path(run + file)), "") << name;
      EXPECT_TRUE(Bytes(Path(session + file)) == Bytes(Path(run + file))) << name << " differs";
    }
    const auto a = Lines(Bytes(Path(session + "/frames.csv")));
    const auto b = Lines(Bytes(Path(run + "/frames.csv")));
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) EXPECT_EQ(WithoutTimes(a[i]), WithoutTimes(b[i]));
  }

  // How often each file is among the scans of a database, all of which is checked.
  static std::map<std::string, int> TimesMapped(const std::string& database) {
    std::map<std::string, int> times;
    std::int64_t next = 0;
    const SessionDatabase session(database, true);
    session.ForEach(0, session.scans(), [&](const ScanRecord& scan) {
      EXPECT_EQ(scan.scan, next++);
      ++times[scan.file];
    });
    return times;
  }

  std::vector<pid_t> children_;
};

// Counts what happens in a folder: files made, written or renamed there. Sends a signal then.
class FolderEvents {
 public:
  explicit FolderEvents(const std::string& folder) : events_(inotify_init1(IN_CLOEXEC)) {
    std::filesystem::create_directories(folder);
    inotify_add_watch(events_, folder.c_str(), IN_MODIFY | IN_CREATE | IN_MOVED_TO);
  }
  ~FolderEvents() { close(events_); }
  FolderEvents(const FolderEvents&) = delete;
  FolderEvents& operator=(const FolderEvents&) = delete;

  // The number of events by which a child had ended, `limit` at most.
  int CountUntilEnd(pid_t child, int limit) {
    const int handle = ProcessHandle(child);
    int count = 0;
    for (bool ended = false; !ended && count < limit;) {
      pollfd both[2] = {{events_, POLLIN, 0}, {handle, POLLIN, 0}};
      poll(both, 2, -1);
      ended = both[1].revents != 0;
      if (both[0].revents != 0) count += TakeEvents();
    }
    close(handle);
    return std::min(count, limit);
  }

 private:
  int TakeEvents() const {
    alignas(inotify_event) char buffer[16384];
    const ssize_t length = read(events_, buffer, sizeof(buffer));
    int count = 0;
    for (ssize_t at = 0; at < length; ++count) {
      const auto* event = reinterpret_cast<const inotify_event*>(buffer + at);
      at += static_cast<ssize_t>(sizeof(inotify_event) + event->len);
    }
    return count;
  }

  int events_;
};

}  // namespace lamina
