#include "tools/watch/room.h"

#include <fmt/format.h>
#include <poll.h>
#include <spdlog/spdlog.h>

#include <cstdint>

#include "backend/session/room.h"
#include "io/file/disk_room.h"
#include "tools/watch/service_notify.h"

namespace lamina {
namespace {

std::string Wanted(const std::string& session, std::uint64_t free, std::uint64_t needed) {
  return fmt::format(
      "{}: the disk is full: {} bytes are free, {} are needed to go on. Nothing is lost; mapping "
      "goes on by itself when there is room",
      session, free, needed);
}

}  // namespace

bool WatchRoom::Enough() {
  const std::uint64_t free = FreeBytes(session_);
  const bool waits = !wanted_.empty();
  if (!waits && free >= kWorkingRoomBytes) return true;
  const std::uint64_t needed = RoomToContinue(session_);
  if (free >= needed) {
    spdlog::info("{}: the disk has room again: mapping goes on", session_);
    wanted_.clear();
    return true;
  }
  wanted_ = Wanted(session_, free, needed);
  if (!waits) spdlog::error("{}", wanted_);
  return false;
}

void SleepFor(std::chrono::milliseconds time) { poll(nullptr, 0, static_cast<int>(time.count())); }

bool WaitForRoom(const std::string& session, std::chrono::seconds at_least,
                 const std::atomic<bool>& stop) {
  const auto end = std::chrono::steady_clock::now() + at_least;
  const std::uint64_t needed = RoomToContinue(session);
  spdlog::error("{}", Wanted(session, FreeBytes(session), needed));
  while (!stop && (std::chrono::steady_clock::now() < end || FreeBytes(session) < needed)) {
    NotifyWatchdog();
    SleepFor(std::chrono::seconds(1));
  }
  return FreeBytes(session) >= needed;
}

}  // namespace lamina
