#include "io/inbox/recordings.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <utility>

#include "core/base/error.h"
#include "io/inbox/file_arrival.h"
#include "io/recording/recording_file.h"

namespace lamina {

namespace fs = std::filesystem;

InboxRecordings::InboxRecordings(std::string root, const ScanSourceOptions& scans,
                                 const InboxOptions& options, std::function<void()> on_opened)
    : root_(std::move(root)),
      scans_(scans),
      settle_s_(options.settle_s),
      opener_(std::move(on_opened)) {}

void InboxRecordings::Add(const std::string& name, std::uint32_t scan) {
  waiting_.emplace(name, Waiting{kNever, scan});
  Count();
}

void InboxRecordings::SetReady(const std::string& name, InboxTime since) {
  const auto found = waiting_.find(name);
  if (found != waiting_.end()) found->second.ready_since = since;
}

void InboxRecordings::Remove(const std::string& name) {
  waiting_.erase(name);
  Count();
}

void InboxRecordings::RemoveFolder(const std::string& folder) {
  for (auto it = waiting_.begin(); it != waiting_.end();) {
    const bool below = it->first.compare(0, folder.size() + 1, folder + "/") == 0;
    it = below ? waiting_.erase(it) : std::next(it);
  }
  Count();
}

void InboxRecordings::Mark(const std::string& name, std::uint32_t scan) {
  const auto found = waiting_.find(name);
  if (found != waiting_.end()) found->second.scan = scan;
}

void InboxRecordings::RemoveUnmarked(std::uint32_t scan) {
  for (auto it = waiting_.begin(); it != waiting_.end();) {
    it = it->second.scan != scan ? waiting_.erase(it) : std::next(it);
  }
  Count();
}

void InboxRecordings::Continue(const SequenceProgress& progress) {
  progress_[progress.sequence] = progress;
  taken_.insert(progress.sequence);
}

InboxTime InboxRecordings::NextDue(bool drain) const {
  if (opening()) return opener_.done() ? InboxTime::min() : kNever;
  if (open_ != nullptr || (drain && !waiting_.empty())) return InboxTime::min();
  InboxTime due = kNever;
  for (const auto& [name, file] : waiting_) {
    if (file.ready_since != kNever) due = std::min(due, After(file.ready_since, settle_s_));
  }
  return due;
}

InboxRecordings::WaitingFiles::const_iterator InboxRecordings::FirstReady(InboxTime now,
                                                                          bool drain) const {
  return std::find_if(waiting_.begin(), waiting_.end(), [&](const auto& entry) {
    const InboxTime since = entry.second.ready_since;
    return drain || (since != kNever && now >= After(since, settle_s_));
  });
}

// Why what was mapped of it before, or beside it, forbids to read it; empty if nothing does.
std::string InboxRecordings::MisfitReason(const std::string& name) const {
  const auto known = progress_.find(name);
  if (known != progress_.end() &&
      (open_->size() < known->second.files ||
       open_->Stamp(known->second.files - 1) != known->second.last_stamp_ns)) {
    return "another recording of this name was mapped before";
  }
  const fs::path folder = fs::path(name).parent_path();
  for (const std::string& file : FilesOfRecording(root_ + "/" + name)) {
    const std::string part = (folder / fs::path(file).filename()).string();
    if (part != name && taken_.count(part) > 0) {
      return fmt::format("its part {} was mapped by itself before", part);
    }
  }
  return "";
}

// Why it is none that could be opened; empty if it may be.
std::string InboxRecordings::WhyNotOpened(const std::string& name) const {
  const FileLook look = LookAtFile(root_, name);
  if (look.what == FileLook::What::kRefused) return look.reason;
  if (look.what == FileLook::What::kDangling) return "is a symbolic link to nothing";
  return "";
}

// Begins to open the next one that is complete. True if `step` says that it is none to be opened.
bool InboxRecordings::BeginNext(InboxTime now, bool drain, Step* step) {
  for (;;) {
    const auto ready = FirstReady(now, drain);
    if (ready == waiting_.end()) return false;
    step->name = ready->first;
    waiting_.erase(ready);
    Count();
    const std::string path = root_ + "/" + step->name;
    std::error_code ignored;
    if (!fs::exists(fs::symlink_status(path, ignored))) continue;  // it has gone unseen
    const bool passed_over = IsPartOfRecording(path) || !NamesRecording(path);
    if (!passed_over) step->reason = WhyNotOpened(step->name);
    if (passed_over || !step->reason.empty()) {
      step->kind = passed_over ? Step::Kind::kPassedOver : Step::Kind::kRefused;
      return true;
    }
    name_ = step->name;
    opener_.Begin(path, scans_);
    Count();
    return false;
  }
}

// What was opened; says why not.
std::string InboxRecordings::TakeOpened() {
  RecordingOpener::Opened opened = opener_.Take();
  open_ = std::move(opened.scans);
  if (open_ == nullptr) return opened.error;
  std::string misfit = MisfitReason(name_);
  if (!misfit.empty()) {
    open_ = nullptr;
    return misfit;
  }
  const auto known = progress_.find(name_);
  next_ = known == progress_.end() ? 0 : known->second.files;
  taken_.insert(name_);
  return "";
}

InboxRecordings::Step InboxRecordings::Next(InboxTime now, bool drain) {
  Step step;
  if (open_ == nullptr && !opening() && BeginNext(now, drain, &step)) return step;
  if (opening()) {
    if (!opener_.done()) return Step();
    const std::string reason = TakeOpened();
    Count();
    if (open_ == nullptr) {
      step = Step();
      step.kind = Step::Kind::kRefused;
      step.name = name_;
      step.reason = reason;
      return step;
    }
  }
  if (open_ == nullptr) return Step();
  if (next_ >= open_->size()) {
    step.kind = Step::Kind::kEnded;
    step.name = name_;
    step.reason = fmt::format("is a recording, of which all {} scans were taken", open_->size());
    open_ = nullptr;
    Count();
    return step;
  }
  step.kind = Step::Kind::kScan;
  InboxFile& scan = step.scan;
  scan.name = NameOfScan(name_, next_);
  scan.path = root_ + "/" + name_;
  scan.sequence = name_;
  scan.stamp_ns = open_->Stamp(next_);
  scan.recorded_stamp = open_->recorded_stamps();
  if (next_ == 0 && open_->size() > 1) scan.next_stamp_ns = open_->Stamp(1);
  scan.recording = open_;
  scan.scan_in_recording = next_++;
  return step;
}

}  // namespace lamina
