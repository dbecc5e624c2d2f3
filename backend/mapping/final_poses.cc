#include "backend/mapping/final_poses.h"

#include <limits>
#include <vector>

namespace lamina {

void FinalPoses::AddScan(std::size_t scan, StampNs stamp_ns, bool skipped, Stream stream,
                         std::int64_t piece) {
  open_.push_back({scan, stamp_ns, skipped, stream, piece, false, SE3(), false, false});
  ++past_[stream].open;
}

void FinalPoses::AddPoses(const Trajectory& poses, Stream stream) {
  auto scan = open_.begin();
  for (const StampedPose& pose : poses) {
    while (scan->stream != stream || scan->skipped || scan->posed) ++scan;
    scan->posed = true;
    scan->T = pose.T_world_lidar;
  }
}

void FinalPoses::Disown(Stream stream, StampNs from_ns) {
  for (Scan& scan : open_)
    scan.disowned = scan.disowned || (scan.stream == stream && scan.stamp_ns >= from_ns);
}

std::size_t FinalPoses::GiveUp(Stream stream) {
  std::size_t count = 0;
  for (Scan& scan : open_) {
    if (scan.given_up || scan.stream != stream) continue;
    scan.given_up = true;
    ++count;
  }
  return count;
}

void FinalPoses::Close(Stream stream) {
  const auto past = past_.find(stream);
  if (past == past_.end()) return;
  past->second.closed = true;
  if (past->second.open == 0) past_.erase(past);
}

const FinalPoses::Scan* FinalPoses::NextOfStream() const {
  for (std::size_t i = 1; i < open_.size(); ++i) {
    if (open_[i].stream == open_[0].stream && !open_[i].skipped) return &open_[i];
  }
  return nullptr;
}

bool FinalPoses::PoseFirst(bool late) {
  Scan& scan = open_.front();
  if (!scan.skipped) return scan.posed;
  const Past& past = past_.at(scan.stream);
  const Scan* next = NextOfStream();
  if (next != nullptr && !next->posed) next = nullptr;
  if (next == nullptr && !late && !past.closed) return false;
  if (past.any) {
    scan.T = past.last.T_world_lidar;
  } else if (next != nullptr) {
    scan.T = next->T;
  }
  if (past.any && next != nullptr && scan.stamp_ns > past.last.stamp_ns &&
      scan.stamp_ns < next->stamp_ns) {
    scan.T = Interpolate(past.last.T_world_lidar, next->T,
                         SecondsBetween(past.last.stamp_ns, scan.stamp_ns) /
                             SecondsBetween(past.last.stamp_ns, next->stamp_ns));
  }
  return true;
}

void FinalPoses::HandOn(std::int64_t before_scan, const Visit& visit) {
  while (!open_.empty() &&
         PoseFirst(static_cast<std::int64_t>(open_.front().number) < before_scan)) {
    const Scan scan = open_.front();
    open_.pop_front();
    const auto past = past_.find(scan.stream);
    const bool own = !scan.skipped && !scan.disowned;
    StampedPose pose{scan.stamp_ns, scan.T};
    if (scan.disowned && past->second.any) pose.T_world_lidar = past->second.last.T_world_lidar;
    visit({scan.number, pose, !own, scan.piece, scan.given_up});
    if (own) past->second.last = pose;
    past->second.any = past->second.any || own;
    if (--past->second.open == 0 && past->second.closed) past_.erase(past);
  }
}

void FinalPoses::ShowOpen(const std::map<Stream, Trajectory>& open, const Visit& visit) const {
  FinalPoses rest = *this;
  for (const auto& [stream, poses] : open) rest.AddPoses(poses, stream);
  rest.HandOn(std::numeric_limits<std::int64_t>::max(), visit);
}

void FinalPoses::Archive(StateArchive& a) {
  open_.resize(a.Size(open_.size(), 1));
  for (Scan& scan : open_) {
    a(&scan.number, &scan.stamp_ns, &scan.skipped, &scan.stream, &scan.piece, &scan.posed, &scan.T,
      &scan.given_up, &scan.disowned);
  }
  std::vector<Stream> streams;
  for (const auto& [stream, past] : past_) streams.push_back(stream);
  a(&streams);
  if (a.reading()) past_.clear();
  for (const Stream stream : streams) {
    Past& past = past_[stream];
    a(&past.any, &past.last, &past.open, &past.closed);
  }
}

}  // namespace lamina
