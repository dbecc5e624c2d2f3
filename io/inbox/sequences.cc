#include "io/inbox/sequences.h"

#include <algorithm>
#include <filesystem>

#include "io/recording/vehicle_scans.h"

namespace lamina {

namespace fs = std::filesystem;

InboxSequences::InboxSequences(std::string root, const ScanSourceOptions& scans,
                               const InboxOptions& options, InboxWatcher* watcher, Drop drop)
    : root_(std::move(root)),
      scans_(scans),
      options_(options),
      watcher_(watcher),
      drop_(std::move(drop)),
      turns_(options.reorder_wait_s) {}

InboxSequence* InboxSequences::Of(const std::string& folder) {
  std::unique_ptr<InboxSequence>& sequence = sequences_[folder];
  if (sequence == nullptr) {
    const std::string directory = folder.empty() ? root_ : root_ + "/" + folder;
    sequence = std::make_unique<InboxSequence>(folder, directory, scans_, options_);
    if (const auto mount = FindMount(scans_.T_vehicle_lidar, folder)) {
      turns_.PutOnVehicle(sequence.get(), mount->vehicle);
    }
    for (const std::string& path : sequence->StampPaths()) {
      by_stamp_file_[path].push_back(sequence.get());
      const fs::path stamps(path);
      const std::string above = stamps.parent_path().string();
      const bool inside = above.size() > root_.size();
      watcher_->WatchFile(inside ? above.substr(root_.size() + 1) : "", stamps.filename().string(),
                          path);
    }
  }
  return sequence.get();
}

void InboxSequences::Add(InboxSequence* sequence, const std::string& file, std::uint32_t scan) {
  const std::size_t before = sequence->size();
  sequence->Add(file, scan);
  waiting_ += sequence->size() - before;
}

void InboxSequences::Remove(InboxSequence* sequence, const std::string& file) {
  if (sequence->Remove(file)) --waiting_;
  Wake(sequence);
}

void InboxSequences::RemoveFolder(const std::string& folder) {
  // All below stand behind it, among others such as `folder-2`.
  for (auto it = sequences_.lower_bound(folder);
       it != sequences_.end() && it->first.compare(0, folder.size(), folder) == 0; ++it) {
    const bool below = it->first.size() == folder.size() || it->first[folder.size()] == '/';
    if (!below) continue;
    waiting_ -= it->second->size();
    it->second->Clear();
    Wake(it->second.get());
  }
}

void InboxSequences::RemoveUnmarked(std::uint32_t scan) {
  for (const auto& [name, sequence] : sequences_) {
    if (sequence->size() == 0) continue;
    waiting_ -= sequence->size();
    sequence->RemoveUnmarked(scan);
    waiting_ += sequence->size();
    // Its stamps may have come, too.
    Wake(sequence.get());
  }
}

void InboxSequences::StampFileSeen(const std::string& folder, const std::string& file,
                                   InboxWatcher::How how) {
  const std::string path = root_ + "/" + (folder.empty() ? file : folder + "/" + file);
  const auto found = by_stamp_file_.find(path);
  if (found == by_stamp_file_.end()) return;
  if (how != InboxWatcher::How::kWritten) watcher_->WatchFile(folder, file, path);
  for (InboxSequence* sequence : found->second) Wake(sequence);
}

void InboxSequences::WakeAll() {
  for (const auto& [name, sequence] : sequences_) Wake(sequence.get());
}

void InboxSequences::Refresh(InboxTime now, bool drain) {
  while (!due_.empty() && due_.begin()->first <= now) {
    InboxSequence* sequence = due_.begin()->second;
    PlaceAt(sequence, false, kNever);
    Wake(sequence);
  }
  while (!awake_.empty()) {
    InboxSequence* sequence = *awake_.begin();
    awake_.erase(awake_.begin());
    Place(sequence, now, drain);
  }
}

// Deals with late and refused files at once.
void InboxSequences::Place(InboxSequence* sequence, InboxTime now, bool drain) {
  using Kind = InboxSequence::Decision::Kind;
  for (;;) {
    const InboxSequence::Decision decision = sequence->Decide(now, drain);
    if (decision.kind == Kind::kWait) return PlaceAt(sequence, false, decision.due);
    const bool unordered = decision.kind == Kind::kHandOut && !decision.recorded_stamp &&
                           scans_.T_vehicle_lidar.size() > 1 && turns_.IsOnVehicle(sequence);
    if (decision.kind == Kind::kHandOut && !unordered) return PlaceAt(sequence, true, kNever);
    sequence->Take(unordered ? Kind::kRefuse : decision.kind);
    --waiting_;
    drop_(sequence->NameOf(decision.file),
          unordered ? "has no stamp, which the sensors of scans.T_vehicle_lidar need: scans of "
                      "several are put in order by them"
                    : decision.reason,
          decision.kind == Kind::kLate);
  }
}

void InboxSequences::PlaceAt(InboxSequence* sequence, bool ready, InboxTime due) {
  Placed& placed = placed_[sequence];
  if (placed.due != kNever) due_.erase({placed.due, sequence});
  placed = {ready, due};
  turns_.SetReady(sequence, ready);
  if (due != kNever) due_.emplace(due, sequence);
}

InboxSequences::NextFile InboxSequences::Next(InboxTime now, bool drain) {
  Refresh(now, drain);
  InboxTime due = kNever;
  while (InboxSequence* sequence = turns_.Next(now, drain, &due)) {
    InboxSequence::Decision decision = sequence->Decide(now, drain);
    if (decision.kind == InboxSequence::Decision::Kind::kHandOut) return {sequence, decision};
    Place(sequence, now, drain);
  }
  return {};
}

void InboxSequences::Take(const NextFile& next) {
  next.sequence->Take(next.decision.kind);
  --waiting_;
  Wake(next.sequence);
}

InboxTime InboxSequences::NextDue(InboxTime now, bool drain) const {
  InboxTime next = kNever;
  turns_.Next(now, drain, &next);
  return due_.empty() ? next : std::min(next, due_.begin()->first);
}

}  // namespace lamina
