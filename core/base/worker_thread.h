// One thread that does pieces of work in the order in which they are handed to it.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>

namespace lamina {

// Thread-safe. For work that waits (for disks); work that computes belongs to core/base/parallel.h.
class WorkerThread {
 public:
  // What work throws goes to `failed`, on the thread; work that follows is done all the same.
  // At most `most_waiting` pieces of work wait.
  WorkerThread(std::function<void(const std::exception&)> failed, std::size_t most_waiting);
  // Does what has been handed over, then ends.
  ~WorkerThread();

  // Waits until there is room: work itself may call it only where there is certainly some.
  void Do(std::function<void()> work);
  // Until all that was handed over so far is done.
  void Wait();

 private:
  void Run();

  std::function<void(const std::exception&)> failed_;
  const std::size_t most_waiting_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> work_;
  std::size_t handed_over_ = 0, done_ = 0;
  bool ending_ = false;
  std::thread thread_;  // the last member: it uses all others
};

}  // namespace lamina
