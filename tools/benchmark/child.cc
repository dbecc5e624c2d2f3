#include "tools/benchmark/child.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>

#include "core/base/error.h"
#include "core/base/stopwatch.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

constexpr int kNotStarted = 127;

double Seconds(const timeval& t) {
  return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
}

// In the child: nothing here may allocate, the parent has other threads.
[[noreturn]] void Become(char* const* argv, const char* log) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const int out = open(log, O_WRONLY | O_CREAT | O_TRUNC, 0644);
  if (out < 0 || dup2(out, STDOUT_FILENO) < 0 || dup2(out, STDERR_FILENO) < 0) _exit(kNotStarted);
  execvp(argv[0], argv);
  _exit(kNotStarted);
}

}  // namespace

ChildUsage RunChild(const std::vector<std::string>& arguments, const std::string& log) {
  std::vector<char*> argv;
  for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
  argv.push_back(nullptr);
  const Stopwatch watch;
  const pid_t child = fork();
  if (child == 0) Become(argv.data(), log.c_str());
  if (child < 0)
    throw OutputError(fmt::format("cannot start {}: {}", arguments[0], std::strerror(errno)));
  int status = 0;
  rusage usage{};
  while (wait4(child, &status, 0, &usage) < 0) {
    if (errno != EINTR)
      throw OutputError(fmt::format("cannot wait for {}: {}", arguments[0], std::strerror(errno)));
  }
  ChildUsage result;
  result.wall_s = 1e-3 * watch.Milliseconds();
  result.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  result.cpu_s = Seconds(usage.ru_utime) + Seconds(usage.ru_stime);
  if (result.code == kNotStarted)
    throw OutputError(fmt::format("cannot start {}, or write {}", arguments[0], log));
  return result;
}

ChildUsage RunChildWell(const std::vector<std::string>& argv, const std::string& log,
                        int also_fine) {
  const ChildUsage usage = RunChild(argv, log);
  if (usage.code == 0 || usage.code == also_fine) return usage;
  std::string said = ReadFile(log);
  constexpr std::size_t kMostBytes = 500;
  if (said.size() > kMostBytes) said = said.substr(said.size() - kMostBytes);
  throw OutputError(fmt::format("{} {} ended with {}:\n{}", argv[0], argv.size() > 1 ? argv[1] : "",
                                usage.code < 0 ? "a signal" : std::to_string(usage.code), said));
}

}  // namespace lamina
