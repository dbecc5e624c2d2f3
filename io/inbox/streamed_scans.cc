#include "io/inbox/streamed_scans.h"

#include <algorithm>
#include <utility>

#include "io/recording/vehicle_scans.h"

namespace lamina {

void StreamedScans::Append(InboxFile file) {
  AppendPast(file.sequence, size(), file.stamp_ns);
  files_.push_back(std::move(file));
}

void StreamedScans::AppendPast(const std::string& recording, std::size_t scan, StampNs stamp_ns) {
  stamps_[recording].push_back({scan, stamp_ns});
}

void StreamedScans::Forget(std::size_t next) {
  while (first_ < next && !files_.empty()) {
    std::deque<Stamped>& stamps = stamps_[files_.front().sequence];
    while (stamps.size() > kHistory && stamps[kHistory].scan < next) stamps.pop_front();
    files_.pop_front();
    ++first_;
  }
}

std::vector<StampNs> StreamedScans::StampsUpTo(std::size_t i, std::size_t begin,
                                               std::size_t most) const {
  const std::deque<Stamped>& all = stamps_.at(File(i).sequence);
  auto at = std::upper_bound(all.begin(), all.end(), i,
                             [](std::size_t scan, const Stamped& s) { return scan < s.scan; });
  std::vector<StampNs> stamps;
  while (at != all.begin() && stamps.size() < most && (--at)->scan >= begin) {
    stamps.push_back(at->stamp_ns);
  }
  std::reverse(stamps.begin(), stamps.end());
  return stamps;
}

std::string StreamedScans::Recording(std::size_t i) const {
  const auto mount = FindMount(options_.T_vehicle_lidar, File(i).sequence);
  return mount ? mount->vehicle : File(i).sequence;
}

SE3 StreamedScans::T_vehicle_lidar(std::size_t i) const {
  const auto mount = FindMount(options_.T_vehicle_lidar, File(i).sequence);
  return mount ? mount->T_vehicle_lidar : SE3();
}

std::string StreamedScans::Name(std::size_t i) const {
  const InboxFile& file = File(i);
  return file.recording == nullptr ? file.path : file.recording->Name(file.scan_in_recording);
}

Scan StreamedScans::Read(std::size_t i) const {
  const InboxFile& file = File(i);
  if (file.recording != nullptr) return file.recording->Read(file.scan_in_recording);
  return ReadStampedScan(file.path, file.stamp_ns, file.recorded_stamp, options_);
}

}  // namespace lamina
