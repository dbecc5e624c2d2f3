// The order of one sequence in the inbox: which of its waiting files comes next, when, and with
// which stamp. The rules are those of io/inbox/inbox.h.
//
// Private to io/inbox.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>

#include "io/file/folder_list.h"
#include "io/inbox/inbox.h"
#include "io/inbox/stamp_lines.h"
#include "io/inbox/time.h"
#include "io/points/scan_file.h"
#include "io/points/scan_names.h"

namespace lamina {

class InboxSequence {
 public:
  // `directory` is where the files are, `folder` its name relative to the inbox.
  InboxSequence(std::string folder, const std::string& directory, const ScanSourceOptions& scans,
                const InboxOptions& options);

  const std::string& folder() const { return folder_; }
  // The full name that a file of this sequence has in the inbox.
  std::string NameOf(const std::string& file) const;
  // Where its stamps may be, given or to come.
  std::vector<std::string> StampPaths() const;

  // Files by their names in the folder. Wants: false for names that are no scans here (text where
  // there are binary files).
  bool Wants(const std::string& file) const;
  bool Has(const std::string& file) const;
  // A file that is still incomplete; no effect on one that waits already.
  void Add(const std::string& file, std::uint32_t scan);
  // Complete since then.
  void SetReady(const std::string& file, InboxTime since);
  bool Remove(const std::string& file);
  void Clear();
  std::size_t size() const { return waiting_.size(); }
  // That a scan of the inbox saw it; and removal of all that this scan did not see.
  void Mark(const std::string& file, std::uint32_t scan);
  void RemoveUnmarked(std::uint32_t scan);

  void Continue(const SequenceProgress& progress);

  // What is to be done with the first file. What follows a decision other than kWait is Take(), or
  // Remove() of the file.
  struct Decision {
    enum class Kind { kWait, kHandOut, kLate, kRefuse };
    Kind kind = Kind::kWait;
    InboxTime due = kNever;  // of kWait: when to ask again, if nothing happens before
    std::string file;
    StampNs stamp_ns = 0;
    bool recorded_stamp = false;
    std::optional<StampNs> next_stamp_ns;
    InboxTime ready_since = kNever;  // of kHandOut: when it was complete; kNever if it is not
    std::string reason;
  };
  // `drain`: nothing more comes. Looks at the stamp file where a stamp is wanted.
  Decision Decide(InboxTime now, bool drain);
  // Takes the first file away, as decided.
  void Take(Decision::Kind kind);

 private:
  // Where stamps come from. Open until the first file is handed out.
  enum class Source { kOpen, kNames, kLineOfNumber, kLineInOrder, kMadeUp };
  struct Key {
    StampNs order = 0;  // the stamp in the name, where that says the order
    std::string file;
  };
  struct Before {
    bool operator()(const Key& a, const Key& b) const {
      return a.order != b.order ? a.order < b.order : NaturalLess(a.file, b.file);
    }
  };
  struct Item {
    InboxTime ready_since = kNever;  // kNever: incomplete
    std::uint32_t scan = 0;
  };
  using Waiting = std::map<Key, Item, Before>;
  struct Stamp {
    StampLines::Line state = StampLines::Line::kThere;
    StampNs ns = 0;
    std::string reason;
  };

  Key KeyOf(const std::string& file) const;
  void Count(const std::string& file, int change);
  void Reorder();
  void RefreshStamps(InboxTime now, bool drain);
  Source CurrentSource(bool drain) const;
  Source SourceOfPast(const SequenceProgress& progress) const;
  std::size_t LinesSkippedInPast(const SequenceProgress& progress) const;
  bool NamesFitLines() const;
  void Settle(Source source);
  Stamp StampOf(const Key& key, std::size_t ahead, Source source) const;
  bool NothingMissingBefore(const Key& a, const Key& b) const;
  InboxTime ReadyDue(Waiting::const_iterator head, Source source) const;
  std::string MisfitReason(const Key& key) const;

  const std::string folder_;
  const std::string directory_;
  const ScanSourceOptions scans_;
  const InboxOptions options_;
  bool text_scans_ = false;
  bool plain_ = false;  // stamps stand beside the scans
  StampLines stamps_;
  InboxTime stamps_changed_at_ = InboxTime::min();

  Waiting waiting_;
  bool by_stamp_ = false;                      // order of waiting_
  std::map<std::int64_t, std::size_t> forms_;  // how many waiting names have each form of stamp
  std::size_t line_numbers_ = 0;               // how many are line numbers
  std::size_t points_ = 0;                     // how many are no text files

  Source source_ = Source::kOpen;
  std::int64_t form_ = 0;           // of kNames
  Source decided_ = Source::kOpen;  // source_ if the file decided on is handed out
  std::size_t handed_out_ = 0;
  // Lines of files that never were handed out, for kLineInOrder.
  std::size_t lines_skipped_ = 0;
  Key last_;
  std::deque<StampNs> gaps_ns_;  // between the stamps in the last names, where these say the order
};

}  // namespace lamina
