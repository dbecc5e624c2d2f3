// Waiting for room on the disk of a session (backend/session/room.h).
#pragma once

#include <atomic>
#include <chrono>
#include <string>

namespace lamina {

// One thread at a time.
class WatchRoom {
 public:
  explicit WatchRoom(std::string session) : session_(std::move(session)) {}

  // Whether there is room to map on. Between the room below which there is not and that from which
  // there is again lies what a checkpoint takes. Says in the log when that changes.
  bool Enough();
  // What is wanted, in words; empty while there is enough.
  const std::string& wanted() const { return wanted_; }

 private:
  std::string session_;
  std::string wanted_;
};

// A signal ends it.
void SleepFor(std::chrono::milliseconds time);

// Until the disk of a session has room to go on, and some time has gone by, or `stop` comes.
// Whether there is room.
bool WaitForRoom(const std::string& session, std::chrono::seconds at_least,
                 const std::atomic<bool>& stop);

}  // namespace lamina
