#include "tools/watch/service_notify.h"

#include <systemd/sd-daemon.h>

#include <atomic>
#include <chrono>

namespace lamina {

void NotifyService(const std::string& state) { sd_notify(0, state.c_str()); }

void NotifyWatchdog() {
  using Clock = std::chrono::steady_clock;
  static std::atomic<Clock::rep> due{0};
  static const std::chrono::microseconds period = [] {
    std::uint64_t usec = 0;
    return std::chrono::microseconds(sd_watchdog_enabled(0, &usec) > 0 ? usec / 3 : 0);
  }();
  if (period.count() == 0) return;
  const Clock::time_point now = Clock::now();
  if (now.time_since_epoch().count() < due) return;
  due = (now + period).time_since_epoch().count();
  sd_notify(0, "WATCHDOG=1");
}

}  // namespace lamina
