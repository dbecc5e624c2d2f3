#include "core/base/worker_thread.h"

#include <exception>
#include <utility>

namespace lamina {

WorkerThread::WorkerThread(std::function<void(const std::exception&)> failed,
                           std::size_t most_waiting)
    : failed_(std::move(failed)), most_waiting_(most_waiting), thread_([this] { Run(); }) {}

WorkerThread::~WorkerThread() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ending_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void WorkerThread::Do(std::function<void()> work) {
  {
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [this] { return work_.size() < most_waiting_; });
    work_.push_back(std::move(work));
    ++handed_over_;
  }
  changed_.notify_all();
}

void WorkerThread::Wait() {
  std::unique_lock<std::mutex> lock(mutex_);
  const std::size_t until = handed_over_;
  changed_.wait(lock, [&] { return done_ >= until; });
}

void WorkerThread::Run() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return ending_ || !work_.empty(); });
    if (work_.empty()) return;
    std::function<void()> work = std::move(work_.front());
    work_.pop_front();
    lock.unlock();
    changed_.notify_all();
    try {
      work();
    } catch (const std::exception& error) {
      failed_(error);
    }
    work = nullptr;  // what it holds may call us when it goes
    lock.lock();
    ++done_;
    changed_.notify_all();
  }
}

}  // namespace lamina
