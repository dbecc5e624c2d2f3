#include "tools/cli/progress.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <utility>

namespace lamina {
namespace {

constexpr int kBarWidth = 30;
constexpr double kBarPeriodS = 0.1;
constexpr double kLinePeriodS = 1.0;

std::string Duration(double seconds) {
  const auto s = static_cast<long>(seconds + 0.5);
  return s < 3600 ? fmt::format("{}:{:02}", s / 60, s % 60)
                  : fmt::format("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60);
}

}  // namespace

RunProgress::RunProgress(Mode mode, std::size_t total, std::string unit)
    : bar_(mode == Mode::kOn || (mode == Mode::kAuto && isatty(STDERR_FILENO) == 1)),
      lines_(mode == Mode::kAuto && !bar_),
      total_(total),
      unit_(std::move(unit)),
      start_(Clock::now()),
      last_(start_) {}

void RunProgress::Step() {
  ++done_;
  const Clock::time_point now = Clock::now();
  const double since = std::chrono::duration<double>(now - last_).count();
  if ((!bar_ && !lines_) || since < (bar_ ? kBarPeriodS : kLinePeriodS)) return;
  last_ = now;
  Show();
}

void RunProgress::Show() {
  const double elapsed = std::chrono::duration<double>(Clock::now() - start_).count();
  const double rate = elapsed > 0.0 ? static_cast<double>(done_) / elapsed : 0.0;
  const double remaining = rate > 0.0 ? static_cast<double>(total_ - done_) / rate : 0.0;
  const std::string text = fmt::format("{0}/{1} {2}, {3:.1f} {2}/s, {4} left", done_, total_, unit_,
                                       rate, Duration(remaining));
  if (!bar_) {
    spdlog::info(text);
    return;
  }
  const auto filled = static_cast<int>(static_cast<double>(kBarWidth) * static_cast<double>(done_) /
                                       static_cast<double>(std::max<std::size_t>(1, total_)));
  fmt::print(stderr, "\r[{}{}] {}\033[K", std::string(static_cast<std::size_t>(filled), '#'),
             std::string(static_cast<std::size_t>(kBarWidth - filled), '.'), text);
  std::fflush(stderr);
}

void RunProgress::Warn(const std::string& line) {
  if (bar_) fmt::print(stderr, "\r\033[K");
  spdlog::warn(line);
}

void RunProgress::WarnRepeated(const std::string& kind, const std::string& line) {
  if (const auto shown = repeated_.Next(kind, line)) Warn(*shown);
}

void RunProgress::Finish() {
  if (!bar_) return;
  Show();
  fmt::print(stderr, "\n");
}

}  // namespace lamina
