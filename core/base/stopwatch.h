// Wall time, for reports alone: nothing that is computed depends on it.
#pragma once

#include <chrono>

namespace lamina {

class Stopwatch {
 public:
  // Since construction.
  double Milliseconds() const { return Between(start_, Now()); }

  // Since the last lap, or construction.
  double LapMilliseconds() {
    const auto now = Now();
    const double ms = Between(lap_, now);
    lap_ = now;
    return ms;
  }

  // Calls f outside of the measured time.
  template <typename F>
  void Outside(const F& f) {
    const auto before = Now();
    f();
    const auto taken = Now() - before;
    start_ += taken;
    lap_ += taken;
  }

 private:
  using Clock = std::chrono::steady_clock;
  static Clock::time_point Now() { return Clock::now(); }
  static double Between(Clock::time_point a, Clock::time_point b) {
    return std::chrono::duration<double, std::milli>(b - a).count();
  }

  Clock::time_point start_ = Now();
  Clock::time_point lap_ = start_;
};

}  // namespace lamina
