#include "io/inbox/inbox.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <map>
#include <set>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "core/base/error.h"
#include "io/inbox/arriving_files.h"
#include "io/inbox/file_arrival.h"
#include "io/inbox/name_set.h"
#include "io/inbox/sequence.h"
#include "io/inbox/turns.h"
#include "io/inbox/watcher.h"
#include "io/recording/vehicle_scans.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

std::string CanonicalFolder(const std::string& folder) {
  std::error_code error;
  const fs::path canonical = fs::canonical(folder, error);
  if (error) {
    throw InputError(fmt::format("{}: cannot be watched: {}", folder, error.message()));
  }
  return canonical.string();
}

}  // namespace

void InboxOptions::Visit(OptionVisitor& v) {
  v.EnumChoice("watch", &watch, {"auto", "inotify", "poll"});
  v.Number("reorder_wait_s", &reorder_wait_s, 0.0, 1e5);
  v.Number("poll_period_s", &poll_period_s, 0.001, 1e5);
  v.Number("settle_s", &settle_s, 0.0, 1e5);
  v.Number("incomplete_wait_s", &incomplete_wait_s, 0.0, 1e5);
}

class Inbox::Impl final : public InboxWatcher::Events {
 public:
  Impl(const std::string& folder, const ScanSourceOptions& scans, const InboxOptions& options,
       Known known, std::function<Clock::time_point()> now)
      : root_(CanonicalFolder(folder)),
        scans_(scans),
        options_(options),
        known_(std::move(known)),
        now_(std::move(now)),
        watcher_(root_, static_cast<InboxWatcher::Kind>(options.watch)),
        arriving_(root_, options),
        turns_(options.reorder_wait_s) {
    Look();
  }

  void Continue(const SequenceProgress& progress) {
    InboxSequence* sequence = SequenceOf(progress.sequence);
    sequence->Continue(progress);
    Wake(sequence);
  }

  std::optional<InboxFile> Next();
  Woken Wait(std::chrono::nanoseconds timeout);
  void Drain();

  InboxWatcher& watcher() { return watcher_; }
  std::vector<InboxNotice> late, refused;
  const NameSet& seen() const { return seen_; }
  std::size_t waiting() const { return waiting_; }

 private:
  using How = InboxWatcher::How;

  struct Placed {
    bool ready = false;
    InboxTime due = kNever;
  };

  void FileSeen(const std::string& folder, const std::string& file, How how) override;
  void FileGone(const std::string& folder, const std::string& file) override;
  void FolderGone(const std::string& folder) override;
  void FolderUnreadable(const std::string& folder, const std::string& reason) override;
  void ScanBegins() override { ++scan_; }
  void ScanEnds() override;

  InboxSequence* SequenceOf(const std::string& folder);
  InboxSequence* FindSequence(const std::string& folder) const;
  void StampFileSeen(const std::string& folder, const std::string& file, How how);
  void LinkSeen(const std::string& name);
  void Follow(const ArrivingFiles::Verdict& verdict, InboxSequence* sequence,
              const std::string& file);
  void CheckArriving();
  void Remove(InboxSequence* sequence, const std::string& file);
  void Refuse(const std::string& name, const std::string& reason);

  void Look();
  void Advance();
  void Wake(InboxSequence* sequence) { awake_.insert(sequence); }
  void Place(InboxSequence* sequence);
  void PlaceAt(InboxSequence* sequence, bool ready, InboxTime due);
  InboxSequence* Turn(InboxTime* due) const { return turns_.Next(now_(), drained_, due); }
  InboxTime NextDue() const;

  const std::string root_;
  const ScanSourceOptions scans_;
  const InboxOptions options_;
  const Known known_;
  const std::function<Clock::time_point()> now_;
  InboxWatcher watcher_;
  ArrivingFiles arriving_;
  NameSet seen_;  // known, handed out, set aside or refused
  std::atomic<std::size_t> waiting_{0};
  bool drained_ = false;
  std::uint32_t scan_ = 0;
  InboxTime next_look_ = kNever;

  std::map<std::string, std::unique_ptr<InboxSequence>> sequences_;
  std::unordered_map<std::string, std::vector<InboxSequence*>> by_stamp_file_;

  // Every sequence with files is asked again when awake, and else when due, or else is ready.
  std::unordered_set<InboxSequence*> awake_;
  std::unordered_map<InboxSequence*, Placed> placed_;
  std::set<std::pair<InboxTime, InboxSequence*>> due_;
  InboxTurns turns_;
};

InboxSequence* Inbox::Impl::FindSequence(const std::string& folder) const {
  const auto found = sequences_.find(folder);
  return found == sequences_.end() ? nullptr : found->second.get();
}

InboxSequence* Inbox::Impl::SequenceOf(const std::string& folder) {
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
      watcher_.WatchFile(inside ? above.substr(root_.size() + 1) : "", stamps.filename().string(),
                         path);
    }
  }
  return sequence.get();
}

void Inbox::Impl::StampFileSeen(const std::string& folder, const std::string& file, How how) {
  const std::string path = root_ + "/" + (folder.empty() ? file : folder + "/" + file);
  const auto found = by_stamp_file_.find(path);
  if (found == by_stamp_file_.end()) return;
  if (how != How::kWritten) watcher_.WatchFile(folder, file, path);
  for (InboxSequence* sequence : found->second) Wake(sequence);
}

// A link whose name is no scan's matters only if it leads to a folder elsewhere: the user may
// believe that its files are seen.
void Inbox::Impl::LinkSeen(const std::string& name) {
  if (seen_.Contains(name)) return;
  std::error_code ignored;
  if (!fs::is_symlink(root_ + "/" + name, ignored)) return;
  if (!fs::is_directory(root_ + "/" + name, ignored)) return;
  const FileLook look = LookAtFile(root_, name);
  if (look.what == FileLook::What::kRefused) Refuse(name, look.reason);
}

void Inbox::Impl::FileSeen(const std::string& folder, const std::string& file, How how) {
  if (file == "times.txt" || file == "timestamps.txt") return StampFileSeen(folder, file, how);
  const std::string name = folder.empty() ? file : folder + "/" + file;
  if (KindOfName(file) == ScanName::kNone) return LinkSeen(name);
  if (seen_.Contains(name)) {
    // It stays where it is when it is kept; made again, it is another file that no run will map.
    const bool made = how == How::kCreated || how == How::kMovedIn;
    if (made && LookAtFile(root_, name).what == FileLook::What::kFile) {
      Refuse(name, "a file of this name was taken before");
    }
    return;
  }
  InboxSequence* sequence = SequenceOf(folder);
  if (sequence->Has(file)) {
    sequence->Mark(file, scan_);
    if (how == How::kFound) return;
    if (!arriving_.Has(name)) return;
  } else {
    if (!sequence->Wants(file)) return LinkSeen(name);
    if (known_ && known_(name)) return seen_.Insert(name);
    const std::size_t before = sequence->size();
    sequence->Add(file, scan_);
    waiting_ += sequence->size() - before;
  }
  Follow(arriving_.See(name, how, watcher_.polls().empty(), now_()), sequence, file);
}

void Inbox::Impl::Follow(const ArrivingFiles::Verdict& verdict, InboxSequence* sequence,
                         const std::string& file) {
  using Kind = ArrivingFiles::Verdict::Kind;
  if (verdict.kind == Kind::kGone || verdict.kind == Kind::kRefused) Remove(sequence, file);
  if (verdict.kind == Kind::kRefused) Refuse(sequence->NameOf(file), verdict.reason);
  if (verdict.kind == Kind::kComplete) sequence->SetReady(file, verdict.since);
  Wake(sequence);
}

void Inbox::Impl::CheckArriving() {
  std::string name;
  ArrivingFiles::Verdict verdict;
  while (arriving_.Check(now_(), &name, &verdict)) {
    const std::size_t slash = name.rfind('/');
    const bool at_root = slash == std::string::npos;
    Follow(verdict, SequenceOf(at_root ? "" : name.substr(0, slash)),
           at_root ? name : name.substr(slash + 1));
  }
}

void Inbox::Impl::Remove(InboxSequence* sequence, const std::string& file) {
  arriving_.Forget(sequence->NameOf(file));
  if (sequence->Remove(file)) --waiting_;
  Wake(sequence);
}

void Inbox::Impl::Refuse(const std::string& name, const std::string& reason) {
  seen_.Insert(name);
  refused.push_back({name, reason});
}

void Inbox::Impl::FileGone(const std::string& folder, const std::string& file) {
  if (InboxSequence* sequence = FindSequence(folder)) Remove(sequence, file);
}

void Inbox::Impl::FolderGone(const std::string& folder) {
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

void Inbox::Impl::FolderUnreadable(const std::string& folder, const std::string& reason) {
  const std::string name = folder + "/";
  if (!seen_.Contains(name)) Refuse(name, fmt::format("the folder cannot be read: {}", reason));
}

void Inbox::Impl::ScanEnds() {
  for (const auto& [name, sequence] : sequences_) {
    if (sequence->size() == 0) continue;
    waiting_ -= sequence->size();
    sequence->RemoveUnmarked(scan_);
    waiting_ += sequence->size();
    // Its stamps may have come, too.
    Wake(sequence.get());
  }
  arriving_.TrustRest(now_());
}

void Inbox::Impl::Look() {
  watcher_.Scan(this);
  next_look_ = watcher_.polls().empty() ? kNever : After(now_(), options_.poll_period_s);
}

void Inbox::Impl::Advance() {
  if (!drained_) {
    watcher_.Pump(this);
    // kNever with polls(): a new folder has just found no watch left.
    const bool polls = !watcher_.polls().empty();
    if (polls && (next_look_ == kNever || now_() >= next_look_)) Look();
    CheckArriving();
  }
  const InboxTime now = now_();
  while (!due_.empty() && due_.begin()->first <= now) {
    InboxSequence* sequence = due_.begin()->second;
    PlaceAt(sequence, false, kNever);
    Wake(sequence);
  }
  while (!awake_.empty()) {
    InboxSequence* sequence = *awake_.begin();
    awake_.erase(awake_.begin());
    Place(sequence);
  }
}

// Deals with late and refused files at once.
void Inbox::Impl::Place(InboxSequence* sequence) {
  using Kind = InboxSequence::Decision::Kind;
  for (;;) {
    const InboxSequence::Decision decision = sequence->Decide(now_(), drained_);
    if (decision.kind == Kind::kWait) return PlaceAt(sequence, false, decision.due);
    const bool unordered = decision.kind == Kind::kHandOut && !decision.recorded_stamp &&
                           scans_.T_vehicle_lidar.size() > 1 && turns_.IsOnVehicle(sequence);
    if (decision.kind == Kind::kHandOut && !unordered) return PlaceAt(sequence, true, kNever);
    const std::string name = sequence->NameOf(decision.file);
    sequence->Take(unordered ? Kind::kRefuse : decision.kind);
    --waiting_;
    arriving_.Forget(name);
    if (unordered) {
      Refuse(name,
             "has no stamp, which the sensors of scans.T_vehicle_lidar need: scans of several are "
             "put in order by them");
    } else if (decision.kind == Kind::kRefuse) {
      Refuse(name, decision.reason);
    } else {
      seen_.Insert(name);
      late.push_back({name, decision.reason});
    }
  }
}

void Inbox::Impl::PlaceAt(InboxSequence* sequence, bool ready, InboxTime due) {
  Placed& placed = placed_[sequence];
  if (placed.due != kNever) due_.erase({placed.due, sequence});
  placed = {ready, due};
  turns_.SetReady(sequence, ready);
  if (due != kNever) due_.emplace(due, sequence);
}

InboxTime Inbox::Impl::NextDue() const {
  InboxTime next = next_look_;
  InboxTime turn = kNever;
  Turn(&turn);
  next = std::min(next, turn);
  if (!due_.empty()) next = std::min(next, due_.begin()->first);
  return std::min(next, arriving_.NextCheck());
}

std::optional<InboxFile> Inbox::Impl::Next() {
  Advance();
  InboxTime due = kNever;
  while (InboxSequence* sequence = Turn(&due)) {
    const InboxSequence::Decision decision = sequence->Decide(now_(), drained_);
    if (decision.kind != InboxSequence::Decision::Kind::kHandOut) {
      Place(sequence);
      continue;
    }
    const std::string name = sequence->NameOf(decision.file);
    // It may have gone, or become another, unseen.
    const FileLook look = LookAtFile(root_, name);
    if (look.what != FileLook::What::kFile) {
      watcher_.CheckRoot();
      Remove(sequence, decision.file);
      if (look.what == FileLook::What::kRefused) Refuse(name, look.reason);
      if (look.what == FileLook::What::kDangling) Refuse(name, "is a symbolic link to nothing");
      Place(sequence);
      awake_.erase(sequence);
      continue;
    }
    sequence->Take(decision.kind);
    --waiting_;
    arriving_.Forget(name);
    seen_.Insert(name);
    Wake(sequence);
    return InboxFile{name,
                     root_ + "/" + name,
                     sequence->folder(),
                     decision.stamp_ns,
                     decision.recorded_stamp,
                     decision.next_stamp_ns};
  }
  return std::nullopt;
}

Inbox::Woken Inbox::Impl::Wait(std::chrono::nanoseconds timeout) {
  const std::size_t notices = late.size() + refused.size();
  const auto ready = [&] {
    Advance();
    InboxTime due = kNever;
    return Turn(&due) != nullptr || late.size() + refused.size() > notices;
  };
  const InboxTime start = now_();
  for (;;) {
    if (ready()) return Woken::kReady;
    const InboxTime now = now_();
    const auto left = timeout - (now - start);
    if (drained_ || left.count() <= 0) return Woken::kTimeout;
    const InboxTime due = NextDue();
    const bool ends = due == kNever || due - now >= left;
    const InboxWatcher::Woken woken =
        watcher_.Wait(ends ? left : std::chrono::nanoseconds(due - now));
    if (woken == InboxWatcher::Woken::kInterrupted) return Woken::kInterrupted;
    if (woken == InboxWatcher::Woken::kTimeout && ends) {
      return ready() ? Woken::kReady : Woken::kTimeout;
    }
  }
}

void Inbox::Impl::Drain() {
  if (drained_) return;
  watcher_.Pump(this);
  watcher_.Scan(this);
  watcher_.Stop();
  drained_ = true;
  next_look_ = kNever;
  arriving_.Clear();
  for (const auto& [name, sequence] : sequences_) Wake(sequence.get());
}

Inbox::Inbox(const std::string& folder, const ScanSourceOptions& scans, const InboxOptions& options,
             Known known, std::function<Clock::time_point()> now) {
  CheckOptions(scans, "scans");
  CheckOptions(options, "inbox");
  impl_ = std::make_unique<Impl>(folder, scans, options, std::move(known), std::move(now));
}

Inbox::~Inbox() = default;

void Inbox::Continue(const SequenceProgress& progress) { impl_->Continue(progress); }
std::optional<InboxFile> Inbox::Next() { return impl_->Next(); }
std::vector<InboxNotice> Inbox::TakeLate() { return std::exchange(impl_->late, {}); }
std::vector<InboxNotice> Inbox::TakeRefused() { return std::exchange(impl_->refused, {}); }
void Inbox::Drain() { impl_->Drain(); }
Inbox::Woken Inbox::Wait(std::chrono::nanoseconds timeout) { return impl_->Wait(timeout); }
void Inbox::Interrupt() noexcept { impl_->watcher().Interrupt(); }
std::size_t Inbox::waiting() const { return impl_->waiting(); }
const std::string& Inbox::polls() const { return impl_->watcher().polls(); }
std::size_t Inbox::seen_bytes() const { return impl_->seen().bytes(); }

}  // namespace lamina
