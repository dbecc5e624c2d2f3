// A recording in one file opened beside other work: one without an index is read through once,
// which of a large one takes minutes.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "io/recording/scan_source.h"

namespace lamina {

// One recording at a time. Not thread-safe.
class RecordingOpener {
 public:
  // `on_done` is called on a thread of its own when a recording is opened, or cannot be.
  explicit RecordingOpener(std::function<void()> on_done = nullptr)
      : on_done_(std::move(on_done)) {}
  // Gives up what is under way.
  ~RecordingOpener();
  RecordingOpener(const RecordingOpener&) = delete;
  RecordingOpener& operator=(const RecordingOpener&) = delete;

  // Nothing must be under way, or done and not taken.
  void Begin(const std::string& path, const ScanSourceOptions& options);
  // Begun, and not taken.
  bool busy() const { return thread_.joinable(); }
  // Take() will not wait.
  bool done() const { return busy() && done_; }

  struct Opened {
    std::shared_ptr<const ScanSource> scans;  // null if it cannot be read
    std::string error;                        // why
  };
  Opened Take();

 private:
  const std::function<void()> on_done_;
  std::thread thread_;
  std::atomic<bool> done_{false}, given_up_{false};
  Opened opened_;
};

}  // namespace lamina
