#include "io/inbox/sequence.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <utility>
#include <vector>

#include "io/recording/scan_layout.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// Larger numbers in names are stamps or serial numbers.
constexpr std::int64_t kMostLines = 1'000'000'000;

// The pace of a sequence is the least of so many gaps: a few of them may have lost a file.
constexpr std::size_t kGaps = 8;

std::string Stem(const std::string& file) { return fs::path(file).stem().string(); }

bool IsLineNumber(const std::string& file) {
  const std::optional<std::int64_t> number = NumberFromName(Stem(file));
  return number && *number < kMostLines;
}

}  // namespace

InboxSequence::InboxSequence(std::string folder, const std::string& directory,
                             const ScanSourceOptions& scans, const InboxOptions& options)
    : folder_(std::move(folder)),
      directory_(directory),
      scans_(scans),
      options_(options),
      stamps_("") {
  const ScanLayout layout = LayoutOfFolder(directory);
  text_scans_ = layout.text_scans;
  plain_ = layout.stamps.parent_path() == fs::path(directory);
  stamps_ = StampLines(layout.stamps.string());
}

std::string InboxSequence::NameOf(const std::string& file) const {
  return folder_.empty() ? file : folder_ + "/" + file;
}

std::vector<std::string> InboxSequence::StampPaths() const {
  if (!plain_) return {stamps_.path()};
  return {directory_ + "/times.txt", directory_ + "/timestamps.txt"};
}

bool InboxSequence::Wants(const std::string& file) const {
  const ScanName kind = KindOfName(file);
  if (kind != ScanName::kText) return kind == ScanName::kPoints;
  const bool text_stream = handed_out_ > 0 && KindOfName(last_.file) == ScanName::kText;
  return text_scans_ && (text_stream || (handed_out_ == 0 && points_ == 0));
}

InboxSequence::Key InboxSequence::KeyOf(const std::string& file) const {
  return {by_stamp_ ? StampFromName(Stem(file)).stamp_ns : 0, file};
}

bool InboxSequence::Has(const std::string& file) const { return waiting_.count(KeyOf(file)) > 0; }

void InboxSequence::Count(const std::string& file, int change) {
  const auto add = [&](std::size_t* count) { *count += static_cast<std::size_t>(change); };
  const auto form = forms_.emplace(StampFromName(Stem(file)).form, 0).first;
  add(&form->second);
  if (form->second == 0) forms_.erase(form);
  if (IsLineNumber(file)) add(&line_numbers_);
  if (KindOfName(file) == ScanName::kPoints) add(&points_);
}

void InboxSequence::Add(const std::string& file, std::uint32_t scan) {
  const bool first_points = points_ == 0 && KindOfName(file) == ScanName::kPoints;
  if (!waiting_.emplace(KeyOf(file), Item{kNever, scan}).second) return;
  Count(file, 1);
  if (first_points && text_scans_ && handed_out_ == 0) {
    // Text files are scans only where there is no other.
    for (auto it = waiting_.begin(); it != waiting_.end();) {
      const bool text = KindOfName(it->first.file) == ScanName::kText;
      if (text) Count(it->first.file, -1);
      it = text ? waiting_.erase(it) : std::next(it);
    }
  }
  Reorder();
}

void InboxSequence::SetReady(const std::string& file, InboxTime since) {
  const auto found = waiting_.find(KeyOf(file));
  if (found != waiting_.end()) found->second.ready_since = since;
}

bool InboxSequence::Remove(const std::string& file) {
  if (waiting_.erase(KeyOf(file)) == 0) return false;
  Count(file, -1);
  Reorder();
  return true;
}

void InboxSequence::Clear() {
  waiting_.clear();
  forms_.clear();
  line_numbers_ = points_ = 0;
}

void InboxSequence::Mark(const std::string& file, std::uint32_t scan) {
  const auto found = waiting_.find(KeyOf(file));
  if (found != waiting_.end()) found->second.scan = scan;
}

void InboxSequence::RemoveUnmarked(std::uint32_t scan) {
  for (auto it = waiting_.begin(); it != waiting_.end();) {
    const bool gone = it->second.scan != scan;
    if (gone) Count(it->first.file, -1);
    it = gone ? waiting_.erase(it) : std::next(it);
  }
  Reorder();
}

// Stamps in names say the order better than the names do, where stamps come from there. Until the
// first file is handed out, each name may change that.
void InboxSequence::Reorder() {
  if (waiting_.empty()) return;
  const bool names_are_stamps =
      !stamps_.exists() && forms_.size() == 1 && forms_.begin()->first != 0;
  const bool by_stamp = source_ == Source::kOpen ? names_are_stamps : source_ == Source::kNames;
  if (by_stamp == by_stamp_) return;
  by_stamp_ = by_stamp;
  Waiting before;
  before.swap(waiting_);
  while (!before.empty()) {
    auto node = before.extract(before.begin());
    node.key() = KeyOf(node.key().file);
    waiting_.insert(std::move(node));
  }
}

void InboxSequence::RefreshStamps(InboxTime now, bool drain) {
  if (plain_ && source_ == Source::kOpen) {
    const std::string path = LayoutOfFolder(directory_).stamps.string();
    if (path != stamps_.path()) stamps_ = StampLines(path);
  }
  const bool rests =
      stamps_changed_at_ != InboxTime::min() && now >= After(stamps_changed_at_, options_.settle_s);
  // What has changed by now does not rest, so its last line is looked at again.
  const bool changed = stamps_.Refresh(drain);
  if (changed) stamps_changed_at_ = now;
  if (!changed && rests) stamps_.Refresh(true);
  Reorder();
}

bool InboxSequence::NamesFitLines() const {
  std::vector<fs::path> files;
  for (const auto& [key, item] : waiting_) files.emplace_back(key.file);
  return NamesAreLineNumbers(files, stamps_.size());
}

InboxSequence::Source InboxSequence::CurrentSource(bool drain) const {
  if (source_ != Source::kOpen) return source_;
  if (stamps_.exists()) {
    const bool numbers = drain ? NamesFitLines() : line_numbers_ == waiting_.size();
    return numbers ? Source::kLineOfNumber : Source::kLineInOrder;
  }
  return by_stamp_ ? Source::kNames : Source::kMadeUp;
}

InboxSequence::Stamp InboxSequence::StampOf(const Key& key, std::size_t ahead,
                                            Source source) const {
  if (source == Source::kNames) return {StampLines::Line::kThere, key.order, ""};
  std::size_t i = handed_out_ + ahead;
  if (source == Source::kMadeUp) return {StampLines::Line::kThere, MadeUpStamp(i, scans_), ""};
  i += lines_skipped_;
  if (source == Source::kLineOfNumber) {
    i = static_cast<std::size_t>(NumberFromName(Stem(key.file)).value_or(kMostLines));
  }
  Stamp stamp;
  stamp.state = stamps_.At(i, &stamp.ns);
  if (stamp.state != StampLines::Line::kThere) stamp.reason = stamps_.Missing(i);
  return stamp;
}

// Which of the sources gave the last file its stamp.
InboxSequence::Source InboxSequence::SourceOfPast(const SequenceProgress& progress) const {
  if (!progress.recorded_stamp) return Source::kMadeUp;
  const NameStamp in_name = StampFromName(Stem(last_.file));
  if (in_name.form != 0 && in_name.stamp_ns == progress.last_stamp_ns) return Source::kNames;
  if (!IsLineNumber(last_.file)) return Source::kLineInOrder;
  const auto gives = [&](std::size_t line) {
    StampNs stamp_ns = 0;
    return stamps_.At(line, &stamp_ns) == StampLines::Line::kThere &&
           stamp_ns == progress.last_stamp_ns;
  };
  const bool by_number = gives(static_cast<std::size_t>(*NumberFromName(Stem(last_.file))));
  return !by_number && gives(progress.files - 1) ? Source::kLineInOrder : Source::kLineOfNumber;
}

// Files set aside or refused took lines, too: the last stamp is found behind its number by so many.
std::size_t InboxSequence::LinesSkippedInPast(const SequenceProgress& progress) const {
  for (std::size_t i = progress.files - 1; i < stamps_.size(); ++i) {
    StampNs stamp_ns = 0;
    stamps_.At(i, &stamp_ns);
    if (stamp_ns == progress.last_stamp_ns) return i + 1 - progress.files;
  }
  return 0;
}

void InboxSequence::Continue(const SequenceProgress& progress) {
  stamps_.Refresh(false);
  handed_out_ = progress.files;
  last_.file = fs::path(progress.last_name).filename().string();
  source_ = SourceOfPast(progress);
  form_ = StampFromName(Stem(last_.file)).form;
  lines_skipped_ = source_ == Source::kLineInOrder ? LinesSkippedInPast(progress) : 0;
  gaps_ns_.clear();
  Reorder();
  by_stamp_ = source_ == Source::kNames;
  last_ = KeyOf(last_.file);
}

bool InboxSequence::NothingMissingBefore(const Key& a, const Key& b) const {
  if (!by_stamp_) return IsNextName(a.file, b.file);
  if (gaps_ns_.size() < kGaps) return false;
  // In double: stamps may be far apart.
  const double gap_ns = static_cast<double>(b.order) - static_cast<double>(a.order);
  const StampNs least_ns = *std::min_element(gaps_ns_.begin(), gaps_ns_.end());
  return gap_ns < 1.5 * static_cast<double>(least_ns);
}

// When the first file, which is complete, may go. The very first of a sequence goes with the second
// one, or alone when that does not come.
InboxTime InboxSequence::ReadyDue(Waiting::const_iterator head, Source source) const {
  const InboxTime since = head->second.ready_since;
  if (handed_out_ > 0) {
    return NothingMissingBefore(last_, head->first) ? since : After(since, options_.reorder_wait_s);
  }
  const InboxTime due = After(since, options_.reorder_wait_s);
  const InboxTime alone = std::max(due, After(since, options_.incomplete_wait_s));
  const auto second = std::next(head);
  if (second == waiting_.end() || second->second.ready_since == kNever) return alone;
  if (StampOf(second->first, 1, source).state != StampLines::Line::kThere) return alone;
  const bool next = NothingMissingBefore(head->first, second->first);
  const InboxTime both = After(second->second.ready_since, next ? 0.0 : options_.reorder_wait_s);
  return std::min(alone, std::max(due, both));
}

// Why the name has no place in the sequence; empty if it has one.
std::string InboxSequence::MisfitReason(const Key& key) const {
  if (source_ == Source::kNames && StampFromName(Stem(key.file)).form != form_) {
    return "its name is no stamp of the form that the sequence's names have";
  }
  if (source_ == Source::kLineOfNumber && !IsLineNumber(key.file)) {
    return "its name is no line number in the stamp file, as the sequence's names are";
  }
  return "";
}

void InboxSequence::Settle(Source source) {
  if (source_ != Source::kOpen) return;
  source_ = source;
  form_ = StampFromName(Stem(waiting_.begin()->first.file)).form;
}

InboxSequence::Decision InboxSequence::Decide(InboxTime now, bool drain) {
  Decision decision;
  if (waiting_.empty()) return decision;
  if (source_ == Source::kOpen) RefreshStamps(now, drain);
  const Source source = CurrentSource(drain);
  // Nothing more comes that could change it.
  if (drain) Settle(source);
  const auto head = waiting_.begin();
  decision.file = head->first.file;
  decision.reason = MisfitReason(head->first);
  if (!decision.reason.empty()) {
    decision.kind = Decision::Kind::kRefuse;
    return decision;
  }
  if (handed_out_ > 0 && !Before()(last_, head->first)) {
    decision.kind = Decision::Kind::kLate;
    decision.reason = fmt::format("came after {} had been handed out", NameOf(last_.file));
    return decision;
  }
  const InboxTime since = head->second.ready_since;
  if (!drain) {
    if (since == kNever) return decision;
    decision.due = ReadyDue(head, source);
    if (now < decision.due) return decision;
  }
  Stamp stamp = StampOf(head->first, 0, source);
  if (stamp.state == StampLines::Line::kMissing) {
    RefreshStamps(now, drain);
    stamp = StampOf(head->first, 0, source);
  }
  if (stamp.state == StampLines::Line::kMissing && !drain) {
    const InboxTime changed = std::max(since, stamps_changed_at_);
    decision.due = After(
        changed, stamps_.has_unfinished_line() ? options_.settle_s : options_.incomplete_wait_s);
    if (now < decision.due) return decision;
  }
  if (stamp.state != StampLines::Line::kThere) {
    decision.kind = Decision::Kind::kRefuse;
    decision.reason = stamp.reason;
    return decision;
  }
  decided_ = source;
  decision.kind = Decision::Kind::kHandOut;
  decision.stamp_ns = stamp.ns;
  decision.recorded_stamp = source != Source::kMadeUp;
  decision.ready_since = since;
  const auto second = std::next(head);
  if (handed_out_ == 0 && second != waiting_.end()) {
    const Stamp next = StampOf(second->first, 1, source);
    if (next.state == StampLines::Line::kThere) decision.next_stamp_ns = next.ns;
  }
  return decision;
}

void InboxSequence::Take(Decision::Kind kind) {
  const bool handed_out = kind == Decision::Kind::kHandOut;
  if (handed_out) Settle(decided_);
  auto head = waiting_.extract(waiting_.begin());
  Count(head.key().file, -1);
  if (handed_out) {
    if (by_stamp_ && handed_out_ > 0) gaps_ns_.push_back(head.key().order - last_.order);
    if (gaps_ns_.size() > kGaps) gaps_ns_.pop_front();
    last_ = std::move(head.key());
    ++handed_out_;
  } else {
    // Its line is its own all the same.
    ++lines_skipped_;
  }
  Reorder();
}

}  // namespace lamina
