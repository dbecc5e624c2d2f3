#include "io/inbox/inbox.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <utility>

#include "core/base/error.h"
#include "io/inbox/arriving_files.h"
#include "io/inbox/file_arrival.h"
#include "io/inbox/name_set.h"
#include "io/inbox/recordings.h"
#include "io/inbox/sequences.h"
#include "io/inbox/watcher.h"
#include "io/recording/recording_file.h"

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
        options_(options),
        known_(std::move(known)),
        now_(std::move(now)),
        watcher_(root_, static_cast<InboxWatcher::Kind>(options.watch)),
        arriving_(root_, options),
        sequences_(root_, scans, options, &watcher_,
                   [this](const std::string& name, const std::string& reason, bool is_late) {
                     Dropped(name, reason, is_late);
                   }),
        recordings_(root_, scans, options, [this] { watcher_.Interrupt(); }) {
    Look();
  }

  void Continue(const SequenceProgress& progress) {
    if (ScanNumber(progress.sequence, progress.last_name)) return recordings_.Continue(progress);
    InboxSequence* sequence = sequences_.Of(progress.sequence);
    sequence->Continue(progress);
    sequences_.Wake(sequence);
  }

  std::optional<InboxFile> Next();
  Woken Wait(std::chrono::nanoseconds timeout);
  void Drain();

  void Interrupt() noexcept {
    interrupted_ = true;
    watcher_.Interrupt();
  }
  bool opening() const { return recordings_.opening(); }

  const InboxWatcher& watcher() const { return watcher_; }
  std::vector<InboxNotice> late, refused, ended;
  const NameSet& seen() const { return seen_; }
  std::size_t waiting() const { return sequences_.waiting() + recordings_.waiting(); }

 private:
  using How = InboxWatcher::How;

  void FileSeen(const std::string& folder, const std::string& file, How how) override;
  void FileGone(const std::string& folder, const std::string& file) override;
  void FolderGone(const std::string& folder) override;
  void FolderUnreadable(const std::string& folder, const std::string& reason) override;
  void ScanBegins() override { ++scan_; }
  void ScanEnds() override;

  void RecordingSeen(const std::string& name, How how);
  void SeenAgain(const std::string& name, How how);
  void LinkSeen(const std::string& name);
  void Follow(const ArrivingFiles::Verdict& verdict, InboxSequence* sequence,
              const std::string& file);
  void FollowRecording(const ArrivingFiles::Verdict& verdict, const std::string& name);
  void CheckArriving();
  void Remove(InboxSequence* sequence, const std::string& file);
  void Refuse(const std::string& name, const std::string& reason);
  void Dropped(const std::string& name, const std::string& reason, bool is_late);

  std::optional<InboxFile> NextOfRecording();
  void Look();
  void Advance();
  InboxTime NextDue() const;

  const std::string root_;
  const InboxOptions options_;
  const Known known_;
  const std::function<Clock::time_point()> now_;
  InboxWatcher watcher_;
  ArrivingFiles arriving_;
  NameSet seen_;        // known, handed out, set aside or refused
  NameSet told_again_;  // of those, that they were made or written anew
  bool drained_ = false;
  // By the caller: the watcher is interrupted as well when a recording has been opened.
  std::atomic<bool> interrupted_{false};
  std::uint32_t scan_ = 0;
  InboxTime next_look_ = kNever;
  InboxSequences sequences_;
  InboxRecordings recordings_;
};

// A file stays where it is when it is kept. Made or written anew it has what no run will map.
void Inbox::Impl::SeenAgain(const std::string& name, How how) {
  if (how == How::kFound || LookAtFile(root_, name).what != FileLook::What::kFile) return;
  const bool told = told_again_.Contains(name);
  if (!told) told_again_.Insert(name);
  if (how != How::kWritten) return Refuse(name, "a file of this name was taken before");
  if (!told) Refuse(name, "was written to after it was taken; what it held then counts");
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
  if (file == "times.txt" || file == "timestamps.txt") {
    return sequences_.StampFileSeen(folder, file, how);
  }
  const std::string name = folder.empty() ? file : folder + "/" + file;
  const bool recording = IsRecordingFile(file);
  if (!recording && KindOfName(file) == ScanName::kNone) return LinkSeen(name);
  if (seen_.Contains(name)) return SeenAgain(name, how);
  if (recording) return RecordingSeen(name, how);
  InboxSequence* sequence = sequences_.Of(folder);
  if (sequence->Has(file)) {
    sequence->Mark(file, scan_);
    if (how == How::kFound) return;
    if (!arriving_.Has(name)) return;
  } else {
    if (!sequence->Wants(file)) return LinkSeen(name);
    if (known_ && known_(name)) return seen_.Insert(name);
    sequences_.Add(sequence, file, scan_);
  }
  Follow(arriving_.See(name, how, watcher_.polls().empty(), now_()), sequence, file);
}

void Inbox::Impl::RecordingSeen(const std::string& name, How how) {
  if (!recordings_.Has(name)) {
    if (known_ && known_(name)) return seen_.Insert(name);
    recordings_.Add(name, scan_);
  } else {
    recordings_.Mark(name, scan_);
    if (how == How::kFound || !arriving_.Has(name)) return;
  }
  FollowRecording(arriving_.See(name, how, watcher_.polls().empty(), now_()), name);
}

void Inbox::Impl::FollowRecording(const ArrivingFiles::Verdict& verdict, const std::string& name) {
  using Kind = ArrivingFiles::Verdict::Kind;
  if (verdict.kind == Kind::kGone || verdict.kind == Kind::kRefused) recordings_.Remove(name);
  if (verdict.kind == Kind::kRefused) Refuse(name, verdict.reason);
  if (verdict.kind == Kind::kComplete) recordings_.SetReady(name, verdict.since);
}

void Inbox::Impl::Follow(const ArrivingFiles::Verdict& verdict, InboxSequence* sequence,
                         const std::string& file) {
  using Kind = ArrivingFiles::Verdict::Kind;
  if (verdict.kind == Kind::kGone || verdict.kind == Kind::kRefused) Remove(sequence, file);
  if (verdict.kind == Kind::kRefused) Refuse(sequence->NameOf(file), verdict.reason);
  if (verdict.kind == Kind::kComplete) sequence->SetReady(file, verdict.since);
  sequences_.Wake(sequence);
}

void Inbox::Impl::CheckArriving() {
  std::string name;
  ArrivingFiles::Verdict verdict;
  while (arriving_.Check(now_(), &name, &verdict)) {
    if (recordings_.Has(name)) {
      FollowRecording(verdict, name);
      continue;
    }
    const std::size_t slash = name.rfind('/');
    const bool at_root = slash == std::string::npos;
    Follow(verdict, sequences_.Of(at_root ? "" : name.substr(0, slash)),
           at_root ? name : name.substr(slash + 1));
  }
}

void Inbox::Impl::Remove(InboxSequence* sequence, const std::string& file) {
  arriving_.Forget(sequence->NameOf(file));
  sequences_.Remove(sequence, file);
}

void Inbox::Impl::Refuse(const std::string& name, const std::string& reason) {
  seen_.Insert(name);
  refused.push_back({name, reason});
}

void Inbox::Impl::Dropped(const std::string& name, const std::string& reason, bool is_late) {
  arriving_.Forget(name);
  if (!is_late) return Refuse(name, reason);
  seen_.Insert(name);
  late.push_back({name, reason});
}

void Inbox::Impl::FileGone(const std::string& folder, const std::string& file) {
  if (IsRecordingFile(file)) {
    const std::string name = folder.empty() ? file : folder + "/" + file;
    arriving_.Forget(name);
    recordings_.Remove(name);
  } else if (KindOfName(file) != ScanName::kNone) {
    Remove(sequences_.Of(folder), file);
  }
}

void Inbox::Impl::FolderGone(const std::string& folder) {
  sequences_.RemoveFolder(folder);
  recordings_.RemoveFolder(folder);
}

void Inbox::Impl::FolderUnreadable(const std::string& folder, const std::string& reason) {
  const std::string name = folder + "/";
  if (!seen_.Contains(name)) Refuse(name, fmt::format("the folder cannot be read: {}", reason));
}

void Inbox::Impl::ScanEnds() {
  sequences_.RemoveUnmarked(scan_);
  recordings_.RemoveUnmarked(scan_);
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
  sequences_.Refresh(now_(), drained_);
}

InboxTime Inbox::Impl::NextDue() const {
  const InboxTime next =
      std::min({next_look_, sequences_.NextDue(now_(), drained_), recordings_.NextDue(drained_)});
  return std::min(next, arriving_.NextCheck());
}

std::optional<InboxFile> Inbox::Impl::Next() {
  Advance();
  for (;;) {
    const InboxSequences::NextFile next = sequences_.Next(now_(), drained_);
    if (next.sequence == nullptr) return NextOfRecording();
    const InboxSequence::Decision& decision = next.decision;
    const std::string name = next.sequence->NameOf(decision.file);
    // It may have gone, or become another, unseen.
    const FileLook look = LookAtFile(root_, name);
    if (look.what != FileLook::What::kFile) {
      watcher_.CheckRoot();
      Remove(next.sequence, decision.file);
      if (look.what == FileLook::What::kRefused) Refuse(name, look.reason);
      if (look.what == FileLook::What::kDangling) Refuse(name, "is a symbolic link to nothing");
      continue;
    }
    sequences_.Take(next);
    arriving_.Forget(name);
    seen_.Insert(name);
    return InboxFile{name,
                     root_ + "/" + name,
                     next.sequence->folder(),
                     decision.stamp_ns,
                     decision.recorded_stamp,
                     decision.next_stamp_ns};
  }
}

std::optional<InboxFile> Inbox::Impl::NextOfRecording() {
  using Kind = InboxRecordings::Step::Kind;
  for (;;) {
    InboxRecordings::Step step = recordings_.Next(now_(), drained_);
    if (step.kind == Kind::kNothing) return std::nullopt;
    if (step.kind == Kind::kScan) return std::move(step.scan);
    arriving_.Forget(step.name);
    if (step.kind == Kind::kRefused) {
      Refuse(step.name, step.reason);
      continue;
    }
    seen_.Insert(step.name);
    if (step.kind == Kind::kEnded) ended.push_back({step.name, step.reason});
  }
}

Inbox::Woken Inbox::Impl::Wait(std::chrono::nanoseconds timeout) {
  const std::size_t notices = late.size() + refused.size();
  const auto ready = [&] {
    Advance();
    return sequences_.Next(now_(), drained_).sequence != nullptr ||
           recordings_.NextDue(drained_) <= now_() || late.size() + refused.size() > notices;
  };
  const InboxTime start = now_();
  for (;;) {
    if (ready()) return Woken::kReady;
    const InboxTime now = now_();
    const auto left = timeout - (now - start);
    if ((drained_ && !opening()) || left.count() <= 0) return Woken::kTimeout;
    const InboxTime due = NextDue();
    const bool ends = due == kNever || due - now >= left;
    const InboxWatcher::Woken woken =
        watcher_.Wait(ends ? left : std::chrono::nanoseconds(due - now));
    if (woken == InboxWatcher::Woken::kInterrupted && interrupted_.exchange(false)) {
      return Woken::kInterrupted;
    }
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
  sequences_.WakeAll();
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
std::vector<InboxNotice> Inbox::TakeEnded() { return std::exchange(impl_->ended, {}); }
void Inbox::Drain() { impl_->Drain(); }
Inbox::Woken Inbox::Wait(std::chrono::nanoseconds timeout) { return impl_->Wait(timeout); }
void Inbox::Interrupt() noexcept { impl_->Interrupt(); }
bool Inbox::opening() const { return impl_->opening(); }
std::size_t Inbox::waiting() const { return impl_->waiting(); }
const std::string& Inbox::polls() const { return impl_->watcher().polls(); }
std::size_t Inbox::seen_bytes() const { return impl_->seen().bytes(); }

}  // namespace lamina
