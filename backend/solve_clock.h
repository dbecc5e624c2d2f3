// Wall time of a solver, stopped while it talks to others.
#pragma once

#include <chrono>

namespace lamina {

class SolveClock {
 public:
  double Milliseconds() const {
    return std::chrono::duration<double, std::milli>(Now() - start_).count();
  }
  // Calls f outside of the measured time.
  template <typename F>
  void Outside(const F& f) {
    const auto before = Now();
    f();
    start_ += Now() - before;
  }

 private:
  static std::chrono::steady_clock::time_point Now() { return std::chrono::steady_clock::now(); }
  std::chrono::steady_clock::time_point start_ = Now();
};

}  // namespace lamina
