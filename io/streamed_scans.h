// Scans that come one by one, as a source for the pipeline: files out of an inbox, numbered in the
// order in which they came.
//
// Only the newest are remembered: those that are to be mapped, and a few before them (the period of
// a sweep is learned from their stamps).
#pragma once

#include <cstddef>
#include <deque>
#include <string>

#include "io/inbox.h"
#include "io/scan_source.h"

namespace lamina {

// Reading is thread-safe as long as nobody calls Append or Forget.
class StreamedScans final : public ScanSource {
 public:
  // How many scans before the next one must be known.
  static constexpr std::size_t kHistory = 10;

  // The first file to be appended gets this number.
  StreamedScans(std::size_t first, const ScanSourceOptions& options)
      : first_(first), options_(options) {}

  void Append(InboxFile file) { files_.push_back(std::move(file)); }
  // Scans before `next` but the last kHistory are not asked for any more.
  void Forget(std::size_t next);

  std::size_t size() const override { return first_ + files_.size(); }
  std::string Name(std::size_t i) const override { return File(i).path; }
  StampNs Stamp(std::size_t i) const override { return File(i).stamp_ns; }
  std::optional<StampNs> StampAfter(std::size_t i) const override { return File(i).next_stamp_ns; }
  Scan Read(std::size_t i) const override;

  const InboxFile& File(std::size_t i) const { return files_.at(i - first_); }
  // Where the run of scans of one sequence that scan i is in begins, as far as it is remembered,
  // and where it ends.
  std::size_t RunBegin(std::size_t i) const;
  std::size_t RunEnd(std::size_t i) const;

 private:
  std::size_t first_;
  ScanSourceOptions options_;
  std::deque<InboxFile> files_;
};

}  // namespace lamina
