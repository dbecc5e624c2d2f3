#include "tools/cli/common.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <filesystem>

#include "core/base/error.h"
#include "io/file/file_writer.h"

namespace lamina {
namespace {

// Set by Ctrl-C. A signal handler may touch little else.
std::atomic<bool> stop_requested{false};
std::atomic<int> stop_signal{0};

void RequestStop(int signal) {
  stop_signal = signal;
  stop_requested = true;
  if (signal == SIGINT) {
    constexpr char kText[] = "\nlamina: stopping in good order; Ctrl-C once more ends it at once\n";
    const int error = errno;
    static_cast<void>(!write(STDERR_FILENO, kText, sizeof(kText) - 1));
    errno = error;
  }
  // A second Ctrl-C ends the program at once.
  std::signal(SIGINT, SIG_DFL);
}

std::size_t ParseIndex(const std::string& text, std::size_t fallback, const std::string& whole) {
  if (text.empty()) return fallback;
  std::size_t value = 0;
  const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error == std::errc() && rest == text.data() + text.size()) return value;
  throw OptionError(
      fmt::format("--frames {}: must have the form A:B, with whole numbers 0 <= A < B", whole));
}

}  // namespace

FrameRange ParseFrameRange(const std::string& text, std::size_t size) {
  if (text.empty()) return {0, size};
  const std::size_t colon = text.find(':');
  if (colon == std::string::npos) ParseIndex("-", 0, text);
  const FrameRange range = {ParseIndex(text.substr(0, colon), 0, text),
                            std::min(size, ParseIndex(text.substr(colon + 1), size, text))};
  if (range.begin < range.end) return range;
  throw OptionError(fmt::format("--frames {}: names none of the {} scans", text, size));
}

void WriteTextFile(const std::string& path, const std::string& text) {
  FileWriter writer(path);
  writer.Write(text);
  writer.Commit();
}

RunProgress::Mode ProgressMode(const std::string& name) {
  return name == "on"    ? RunProgress::Mode::kOn
         : name == "off" ? RunProgress::Mode::kOff
                         : RunProgress::Mode::kAuto;
}

std::unique_ptr<tbb::global_control> LimitThreads(int threads) {
  constexpr int kMost = 1024;
  if (threads < 0 || threads > kMost) {
    throw OptionError(fmt::format("--threads = {}: must be in [0, {}]", threads, kMost));
  }
  if (threads == 0) return nullptr;
  return std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism,
                                               static_cast<std::size_t>(threads));
}

const std::atomic<bool>& StopOnSignals() {
  std::signal(SIGINT, RequestStop);
  std::signal(SIGTERM, RequestStop);
  return stop_requested;
}

int StopSignal() { return stop_signal; }

}  // namespace lamina
