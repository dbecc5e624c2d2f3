#include "io/streamed_scans.h"

namespace lamina {

void StreamedScans::Forget(std::size_t next) {
  while (first_ + kHistory < next && !files_.empty()) {
    files_.pop_front();
    ++first_;
  }
}

Scan StreamedScans::Read(std::size_t i) const {
  const InboxFile& file = File(i);
  return ReadStampedScan(file.path, file.stamp_ns, file.recorded_stamp, options_);
}

std::size_t StreamedScans::RunBegin(std::size_t i) const {
  std::size_t begin = i;
  while (begin > first_ && File(begin - 1).sequence == File(i).sequence) --begin;
  return begin;
}

std::size_t StreamedScans::RunEnd(std::size_t i) const {
  std::size_t end = i + 1;
  while (end < size() && File(end).sequence == File(i).sequence) ++end;
  return end;
}

}  // namespace lamina
