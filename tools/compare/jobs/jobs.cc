#include "tools/compare/jobs/jobs.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>

#include "core/base/error.h"
#include "core/base/stopwatch.h"
#include "tools/cli/common.h"
#include "tools/compare/jobs/task.h"

namespace lamina {
namespace {

[[noreturn]] void Fail(const std::string& what) {
  throw OutputError(fmt::format("cannot {}: {}", what, std::strerror(errno)));
}

// The limit is one of processor time, so that a busy machine fails nothing; a job that hangs, or
// has to share its core with too many, ends when this many times as much has gone by on the wall.
constexpr double kWallPerCpu = 4.0;

// A job while it runs. Ends its process when it is destroyed.
class Process {
 public:
  explicit Process(const CompareTask& task) : task_(task) {
    const std::string stem = RowPath(task.row_folder, task.methods.front());
    task_path_ = stem + ".task";
    log_path_ = stem + ".log";
    WriteTextFile(task_path_, TaskToJson(task).dump(1) + "\n");
    std::array<int, 2> ends;
    if (pipe2(ends.data(), O_CLOEXEC) != 0) Fail("make a pipe");
    pipe_ = ends[0];
    const std::string program = std::filesystem::read_symlink("/proc/self/exe").string();
    const std::string log = log_path_;
    const std::array<const char*, 5> argv = {program.c_str(), "compare", kWorkerOption,
                                             task_path_.c_str(), nullptr};
    const pid_t parent = getpid();
    child_ = fork();
    if (child_ == 0) Become(argv.data(), ends[1], log.c_str(), parent, task_.time_limit_s);
    const int error = errno;
    close(ends[1]);
    errno = error;
    if (child_ < 0) {
      close(pipe_);
      Fail("start a job");
    }
  }
  ~Process() {
    End();
    close(pipe_);
    std::error_code ignored;
    std::filesystem::remove(task_path_, ignored);
    std::filesystem::remove(log_path_, ignored);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  const CompareTask& task() const { return task_; }
  int pipe() const { return pipe_; }
  double SecondsLeft() const {
    return kWallPerCpu * task_.time_limit_s - 1e-3 * watch_.Milliseconds();
  }

  // Steps that have come in; *ended if the process has closed its end.
  std::size_t ReadSteps(bool* ended) const {
    std::array<char, 256> bytes;
    const ssize_t count = read(pipe_, bytes.data(), bytes.size());
    *ended = count == 0 || (count < 0 && errno != EINTR);
    return count > 0 ? static_cast<std::size_t>(count) : 0;
  }

  // Waits for its end and says how it ended.
  std::string Wait() {
    int status = 0;
    overran_ = false;
    while (waitpid(child_, &status, 0) < 0 && errno == EINTR) {
    }
    child_ = 0;
    overran_ = WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU;
    const std::string how = WIFSIGNALED(status)
                                ? fmt::format("was ended by signal {}", WTERMSIG(status))
                                : fmt::format("ended with code {}", WEXITSTATUS(status));
    std::ifstream file(log_path_);
    std::string said((std::istreambuf_iterator<char>(file)), {});
    while (!said.empty() && said.back() == '\n') said.pop_back();
    constexpr std::size_t kMostBytes = 300;
    if (said.size() > kMostBytes) said = said.substr(said.size() - kMostBytes);
    return said.empty() ? how : how + ": " + said;
  }

  // It used up its processor time; known after Wait.
  bool overran() const { return overran_; }

  void End() {
    if (child_ <= 0) return;
    kill(child_, SIGKILL);
    Wait();
  }

 private:
  // In the child: nothing here may allocate, the parent has other threads.
  [[noreturn]] static void Become(const char* const* argv, int pipe_end, const char* log,
                                  pid_t parent, double time_limit_s) {
    // Ctrl-C is for the parent, which then ends its jobs; and they end with it.
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent) _exit(127);
    const rlimit cpu = {static_cast<rlim_t>(std::ceil(time_limit_s)), RLIM_INFINITY};
    setrlimit(RLIMIT_CPU, &cpu);
    const int out = open(log, O_WRONLY | O_CREAT | O_TRUNC, 0644);
    if (out < 0 || dup2(out, STDOUT_FILENO) < 0 || dup2(out, STDERR_FILENO) < 0) _exit(127);
    // dup2 to itself would leave it to be closed.
    if (pipe_end == kProgressFd) {
      fcntl(pipe_end, F_SETFD, 0);
    } else if (dup2(pipe_end, kProgressFd) < 0) {
      _exit(127);
    }
    execv(argv[0], const_cast<char* const*>(argv));
    _exit(127);
  }

  CompareTask task_;
  std::string task_path_, log_path_;
  int pipe_ = -1;
  pid_t child_ = 0;
  bool overran_ = false;
  Stopwatch watch_;
};

struct Running {
  std::unique_ptr<Process> process;
  std::size_t steps = 0;
};

// Rows that the job owes, and reports of those that failed.
void CloseBooks(const CompareTask& task, const std::string& reason, double time_limit_s,
                const CompareJobReports& reports) {
  for (const std::string& method : task.methods) {
    const std::string path = RowPath(task.row_folder, method);
    std::optional<CompareRow> row = ReadRow(path, task.fingerprint);
    if (!row) {
      row.emplace();
      row->sequence = task.sequence;
      row->method = method;
      row->fingerprint = task.fingerprint;
      row->reason = reason;
      row->time_limit_s = time_limit_s;
      WriteRow(path, *row);
    }
    if (!row->good) reports.on_failure(*row);
  }
}

// Until a job says something, one's time is up, or a signal comes.
void WaitForNews(const std::vector<Running>& running, std::vector<pollfd>* polled) {
  polled->clear();
  double wait_s = 3600.0;
  for (const Running& r : running) {
    polled->push_back({r.process->pipe(), POLLIN, 0});
    wait_s = std::min(wait_s, r.process->SecondsLeft());
  }
  // A little later than the deadline, so as not to wake before it. A stop that is set just before
  // the wait begins would go unheard: so no wait is longer than a second.
  const double ms = std::clamp(1e3 * wait_s + 1.0, 0.0, 1000.0);
  if (poll(polled->data(), polled->size(), static_cast<int>(ms)) < 0) {
    for (pollfd& p : *polled) p.revents = 0;  // interrupted: nothing was told
  }
}

}  // namespace

std::string RowPath(const std::string& row_folder, const std::string& method) {
  return (std::filesystem::path(row_folder) / (method + ".json")).string();
}

std::size_t StepsOf(const CompareTask& task, std::size_t scans) {
  return scans * task.methods.size();
}

bool RunCompareTasks(const std::vector<CompareTask>& tasks, std::size_t scans, std::size_t at_once,
                     const std::atomic<bool>& stop, const CompareJobReports& reports) {
  std::vector<Running> running;
  std::vector<pollfd> polled;
  std::size_t next = 0;
  while (next < tasks.size() || !running.empty()) {
    if (stop) return false;  // what runs is ended by its destructor
    while (running.size() < at_once && next < tasks.size()) {
      // What an earlier call has left must not pass for this one's.
      for (const std::string& method : tasks[next].methods) {
        std::filesystem::remove(RowPath(tasks[next].row_folder, method));
      }
      running.push_back({std::make_unique<Process>(tasks[next++]), 0});
    }
    WaitForNews(running, &polled);
    for (std::size_t i = running.size(); i-- > 0;) {
      Running& r = running[i];
      const CompareTask task = r.process->task();
      const std::size_t all = StepsOf(task, scans);
      bool ended = false;
      std::size_t steps = polled[i].revents == 0 ? 0 : r.process->ReadSteps(&ended);
      bool late = !ended && r.process->SecondsLeft() <= 0.0;
      if (ended || late) steps = all;
      for (; steps > 0 && r.steps < all; --steps, ++r.steps) reports.on_step();
      if (!ended && !late) continue;
      std::string reason;
      if (late) {
        r.process->End();
      } else {
        reason = r.process->Wait();
        late = r.process->overran();
      }
      if (late) reason = fmt::format("the time limit of {:g} s was reached", task.time_limit_s);
      CloseBooks(task, reason, late ? task.time_limit_s : 0.0, reports);
      running.erase(running.begin() + static_cast<std::ptrdiff_t>(i));
    }
  }
  return true;
}

}  // namespace lamina
