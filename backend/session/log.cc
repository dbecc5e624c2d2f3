#include "backend/session/log.h"

#include <spdlog/spdlog.h>

#include <memory>
#include <utility>

#include "core/base/error.h"

namespace lamina {

void LogFailure(const std::exception& error) {
  spdlog::error("{} (the stream goes on; this will be tried again)", error.what());
}

SessionLog::SessionLog(const std::string& database,
                       std::function<void(const ScanRecord&)> on_durable)
    : database_(database, false), on_durable_(std::move(on_durable)), thread_([this] { Run(); }) {}

SessionLog::~SessionLog() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ending_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void SessionLog::Put(const ScanRecord& scan) {
  auto copy = std::make_unique<ScanRecord>(scan);
  const ScanRecord* const row = copy.get();
  Add({[row](SessionDatabase* database) { database->Put(*row); }, std::move(copy)});
}

void SessionLog::Put(const SessionSolve& solve) {
  Add({[solve](SessionDatabase* database) { database->Put(solve); }, nullptr});
}

void SessionLog::Finalise(const SessionPose& pose) {
  Add({[pose](SessionDatabase* database) { database->Finalise(pose); }, nullptr});
}

void SessionLog::SetAside(const std::string& file, const std::string& reason) {
  Add({[file, reason](SessionDatabase* database) { database->SetAside(file, reason); }, nullptr});
}

void SessionLog::WaitDurable() {
  std::unique_lock<std::mutex> lock(mutex_);
  const std::size_t until = handed_over_;
  changed_.wait(lock, [&] { return failure_ != nullptr || durable_ >= until; });
  ThrowIfFailed();
}

void SessionLog::ThrowIfFailed() const {
  if (failure_) std::rethrow_exception(failure_);
}

void SessionLog::Add(Entry entry) {
  constexpr std::size_t kMostWaiting = 512;
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait(lock, [&] { return failure_ != nullptr || waiting_.size() < kMostWaiting; });
  ThrowIfFailed();
  waiting_.push_back(std::move(entry));
  ++handed_over_;
  lock.unlock();
  changed_.notify_all();
}

// What it holds is durable whatever its length: not a reason to stop.
void SessionLog::LimitDatabaseLog() {
  try {
    database_.LimitLog();
  } catch (const OutputError& error) {
    spdlog::error("{} (the stream goes on; this will be tried again)", error.what());
  }
}

void SessionLog::Run() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return ending_ || !waiting_.empty(); });
    if (waiting_.empty()) return;
    const std::vector<Entry> entries = std::exchange(waiting_, {});
    lock.unlock();
    changed_.notify_all();
    std::exception_ptr failure;
    try {
      database_.Begin();
      for (const Entry& entry : entries) entry.change(&database_);
      database_.Commit();
      for (const Entry& entry : entries) {
        if (entry.scan && on_durable_) on_durable_(*entry.scan);
      }
    } catch (...) {
      failure = std::current_exception();
    }
    if (!failure) LimitDatabaseLog();
    lock.lock();
    durable_ += entries.size();
    failure_ = failure;
    changed_.notify_all();
    if (failure_) return;
  }
}

}  // namespace lamina
