// Tells a person how a run goes: a bar on a terminal, a log line a second elsewhere.
#pragma once

#include <chrono>
#include <cstddef>
#include <string>

#include "tools/cli/repeated_lines.h"

namespace lamina {

// Not thread-safe. Writes to standard error.
class RunProgress {
 public:
  enum class Mode { kAuto, kOn, kOff };  // kAuto: a bar if standard error is a terminal

  // `unit`: what is counted, in the plural.
  RunProgress(Mode mode, std::size_t total, std::string unit = "scans");
  // One more is done.
  void Step();
  // A line that must be seen, above the bar.
  void Warn(const std::string& line);
  // One that may come for many scans: the first of this kind, then some
  // (tools/cli/repeated_lines.h).
  void WarnRepeated(const std::string& kind, const std::string& line);
  // Ends the bar's line.
  void Finish();

 private:
  using Clock = std::chrono::steady_clock;
  void Show();

  bool bar_, lines_;
  std::size_t total_, done_ = 0;
  std::string unit_;
  Clock::time_point start_, last_;
  RepeatedLines repeated_;
};

}  // namespace lamina
