// Makes what happens in a session durable, beside the mapping: a thread of its own takes all that
// has been handed over by then, and writes it to the database as one transaction.
#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "io/store/session_database.h"

namespace lamina {

// Says in the log what has failed, of work that will be tried again.
void LogFailure(const std::exception& error);

// Thread-safe. If the database cannot be written, all that follows throws its OutputError: nothing
// may be called done any more.
class SessionLog {
 public:
  // `on_durable` is told each scan once it is on disk, on the log's thread.
  SessionLog(const std::string& database, std::function<void(const ScanRecord&)> on_durable);
  // Writes what is left, if it can.
  ~SessionLog();

  // Waits while too much is waiting already: who maps faster than the disk writes, waits for it.
  void Put(const ScanRecord& scan);
  void Put(const SessionSolve& solve);
  void Finalise(const SessionPose& pose);
  void SetAside(const std::string& file, const std::string& reason);

  // Until all that was handed over so far is on disk.
  void WaitDurable();

 private:
  using Change = std::function<void(SessionDatabase*)>;
  struct Entry {
    Change change;
    std::unique_ptr<ScanRecord> scan;  // for on_durable
  };
  void Add(Entry entry);
  void Run();
  void LimitDatabaseLog();
  void ThrowIfFailed() const;

  SessionDatabase database_;
  std::function<void(const ScanRecord&)> on_durable_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Entry> waiting_;
  std::size_t handed_over_ = 0, durable_ = 0;
  bool ending_ = false;
  std::exception_ptr failure_;
  std::thread thread_;  // the last member: it uses all others
};

}  // namespace lamina
