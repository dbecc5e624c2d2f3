// What a service manager is told (systemd's notification protocol; silence where there is none).
#pragma once

#include <string>

namespace lamina {

// "READY=1", "STOPPING=1", "RELOADING=1", "STATUS=...". Thread-safe.
void NotifyService(const std::string& state);

// Tells the watchdog that all is well, at most as often as it wants to know. Thread-safe.
void NotifyWatchdog();

}  // namespace lamina
