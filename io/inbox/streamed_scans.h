// Scans that come one by one, as a source for the pipeline: files out of an inbox, numbered in the
// order in which they came.
//
// Only the newest are remembered: those that are to be mapped, and of each recording (sequence of
// the inbox) the stamps of a few before them, from which the period of a sweep is learned.
#pragma once

#include <cstddef>
#include <deque>
#include <map>
#include <string>
#include <vector>

#include "io/inbox/inbox.h"
#include "io/recording/scan_source.h"

namespace lamina {

// Reading is thread-safe while neither Append nor Forget runs.
class StreamedScans final : public ScanSource {
 public:
  // How many scans of its recording before the next one must be known.
  static constexpr std::size_t kHistory = 10;

  // The first file to be appended gets this number.
  StreamedScans(std::size_t first, const ScanSourceOptions& options)
      : first_(first), options_(options) {}

  void Append(InboxFile file);
  // A scan before all of these, which is not asked for itself; later ones of its recording follow.
  void AppendPast(const std::string& recording, std::size_t scan, StampNs stamp_ns);
  // Scans before `next` are not asked for any more.
  void Forget(std::size_t next);

  std::size_t size() const override { return first_ + files_.size(); }
  std::string Name(std::size_t i) const override;
  StampNs Stamp(std::size_t i) const override { return File(i).stamp_ns; }
  std::string Recording(std::size_t i) const override;
  std::string Sensor(std::size_t i) const override { return File(i).sequence; }
  SE3 T_vehicle_lidar(std::size_t i) const override;
  std::vector<StampNs> StampsUpTo(std::size_t i, std::size_t begin,
                                  std::size_t most) const override;
  std::optional<StampNs> StampAfter(std::size_t i) const override { return File(i).next_stamp_ns; }
  Scan Read(std::size_t i) const override;

  const InboxFile& File(std::size_t i) const { return files_.at(i - first_); }

 private:
  struct Stamped {
    std::size_t scan;
    StampNs stamp_ns;
  };
  std::size_t first_;
  ScanSourceOptions options_;
  std::deque<InboxFile> files_;
  std::map<std::string, std::deque<Stamped>> stamps_;  // by recording
};

}  // namespace lamina
