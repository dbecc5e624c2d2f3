#include "io/recording/recording_opener.h"

#include <stdexcept>
#include <utility>

#include "io/recording/recording_file.h"
#include "io/stream/byte_stream.h"

namespace lamina {

RecordingOpener::~RecordingOpener() {
  given_up_ = true;
  if (thread_.joinable()) thread_.join();
}

void RecordingOpener::Begin(const std::string& path, const ScanSourceOptions& options) {
  if (busy()) throw std::logic_error("RecordingOpener::Begin: a recording is being opened");
  done_ = false;
  thread_ = std::thread([this, path, options] {
    const GiveUpReads give_up(&given_up_);
    try {
      opened_.scans = OpenRecordingFile(path, options);
    } catch (const std::exception& error) {
      opened_.error = error.what();
    }
    done_ = true;
    if (on_done_) on_done_();
  });
}

RecordingOpener::Opened RecordingOpener::Take() {
  if (!busy()) throw std::logic_error("RecordingOpener::Take: no recording is being opened");
  thread_.join();
  return std::exchange(opened_, {});
}

}  // namespace lamina
