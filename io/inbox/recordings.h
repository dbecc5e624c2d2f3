// Recordings in one file that come into an inbox (bags, MCAP files, captures): which is read next,
// and its scans one by one. The rules are those of io/inbox/inbox.h.
//
// Private to io/inbox.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "io/file/folder_list.h"
#include "io/inbox/inbox.h"
#include "io/inbox/time.h"
#include "io/recording/recording_opener.h"
#include "io/recording/scan_source.h"

namespace lamina {

// One thread at a time; waiting() from any. Names are relative to the inbox.
class InboxRecordings {
 public:
  // `root` must be canonical. `on_opened` is called on a thread of its own when a recording that
  // Next() has begun to open is open, or cannot be.
  InboxRecordings(std::string root, const ScanSourceOptions& scans, const InboxOptions& options,
                  std::function<void()> on_opened);

  // A file that is still incomplete; no effect on one that waits already.
  void Add(const std::string& name, std::uint32_t scan);
  bool Has(const std::string& name) const { return waiting_.count(name) > 0; }
  void SetReady(const std::string& name, InboxTime since);
  void Remove(const std::string& name);
  void RemoveFolder(const std::string& folder);
  void Mark(const std::string& name, std::uint32_t scan);
  void RemoveUnmarked(std::uint32_t scan);

  // That its scans up to this one were handed out in an earlier run.
  void Continue(const SequenceProgress& progress);

  // When Next() has something to do; kNever: not before something happens.
  InboxTime NextDue(bool drain) const;
  struct Step {
    // kPassedOver: a part of another, or of no recording.
    enum class Kind { kNothing, kScan, kEnded, kRefused, kPassedOver };
    Kind kind = Kind::kNothing;
    InboxFile scan;      // of kScan
    std::string name;    // but of kScan: the file
    std::string reason;  // of kRefused; what is told of kEnded
  };
  // The next scan of the recording that is being read, or of the next one that is complete: that is
  // opened beside, and there is nothing until it is.
  Step Next(InboxTime now, bool drain);
  bool opening() const { return opener_.busy(); }

  // Recordings that wait, or are being read.
  std::size_t waiting() const { return count_; }

 private:
  struct NameBefore {
    bool operator()(const std::string& a, const std::string& b) const { return NaturalLess(a, b); }
  };
  struct Waiting {
    InboxTime ready_since = kNever;
    std::uint32_t scan = 0;
  };
  using WaitingFiles = std::map<std::string, Waiting, NameBefore>;

  void Count() { count_ = waiting_.size() + (open_ != nullptr || opening() ? 1 : 0); }
  WaitingFiles::const_iterator FirstReady(InboxTime now, bool drain) const;
  bool BeginNext(InboxTime now, bool drain, Step* step);
  std::string WhyNotOpened(const std::string& name) const;
  std::string TakeOpened();
  std::string MisfitReason(const std::string& name) const;

  const std::string root_;
  const ScanSourceOptions scans_;
  const double settle_s_;
  WaitingFiles waiting_;
  std::map<std::string, SequenceProgress> progress_;
  std::set<std::string> taken_;  // in this run or an earlier one
  std::string name_;             // of the one that is being opened or read
  std::shared_ptr<const ScanSource> open_;
  std::size_t next_ = 0;
  std::atomic<std::size_t> count_{0};
  RecordingOpener opener_;
};

}  // namespace lamina
