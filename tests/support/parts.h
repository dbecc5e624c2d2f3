// Threads in the place of processes that share out work.
#pragma once

#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "backend/submaps/work_sharing.h"

namespace lamina {

// Each part waits until all have given their bytes.
class Exchange {
 public:
  explicit Exchange(std::size_t parts) : given_(parts) {}

  std::vector<std::string> Of(std::size_t part, const std::string& bytes) {
    std::unique_lock<std::mutex> lock(mutex_);
    const std::size_t round = round_;
    given_[part] = bytes;
    if (++count_ == given_.size()) {
      taken_ = given_;
      count_ = 0;
      ++round_;
      all_there_.notify_all();
    }
    all_there_.wait(lock, [&] { return round_ != round; });
    return taken_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable all_there_;
  std::vector<std::string> given_, taken_;
  std::size_t count_ = 0, round_ = 0;
};

// Calls run(sharing) for so many parts at once.
template <typename Run>
void InParts(std::size_t parts, const Run& run) {
  Exchange exchange(parts);
  std::vector<std::thread> threads;
  for (std::size_t part = 0; part < parts; ++part) {
    threads.emplace_back([&, part] {
      run(WorkSharing{part, parts,
                      [&, part](const std::string& bytes) { return exchange.Of(part, bytes); },
                      [&, part](const std::string& bytes) {
                        std::vector<std::string> all = exchange.Of(part, bytes);
                        return part == 0 ? all : std::vector<std::string>();
                      }});
    });
  }
  for (std::thread& thread : threads) thread.join();
}

}  // namespace lamina
