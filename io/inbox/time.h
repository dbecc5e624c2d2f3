// Points in time for the waits of the inbox.
//
// Private to io/inbox.
#pragma once

#include <chrono>

namespace lamina {

using InboxTime = std::chrono::steady_clock::time_point;

// Waits that never end.
inline constexpr InboxTime kNever = InboxTime::max();

inline InboxTime After(InboxTime time, double seconds) {
  return time +
         std::chrono::duration_cast<InboxTime::duration>(std::chrono::duration<double>(seconds));
}

}  // namespace lamina
