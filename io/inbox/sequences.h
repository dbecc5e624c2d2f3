// The sequences of an inbox, and which of them has a file to hand out. The rules are those of
// io/inbox/inbox.h.
//
// Private to io/inbox.
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "io/inbox/inbox.h"
#include "io/inbox/sequence.h"
#include "io/inbox/time.h"
#include "io/inbox/turns.h"
#include "io/inbox/watcher.h"

namespace lamina {

// One thread at a time; waiting() from any.
class InboxSequences {
 public:
  // Called for files that are set aside (`late`) or refused when their turn comes.
  using Drop = std::function<void(const std::string& name, const std::string& reason, bool late)>;

  // `root` must be canonical.
  InboxSequences(std::string root, const ScanSourceOptions& scans, const InboxOptions& options,
                 InboxWatcher* watcher, Drop drop);

  // That of a folder, relative to the root; made if it is not there.
  InboxSequence* Of(const std::string& folder);

  void Add(InboxSequence* sequence, const std::string& file, std::uint32_t scan);
  void Remove(InboxSequence* sequence, const std::string& file);
  // With all that was below.
  void RemoveFolder(const std::string& folder);
  // All that was not marked by this look at the inbox.
  void RemoveUnmarked(std::uint32_t scan);
  void StampFileSeen(const std::string& folder, const std::string& file, InboxWatcher::How how);

  // Something has changed: it is asked again at the next Refresh().
  void Wake(InboxSequence* sequence) { awake_.insert(sequence); }
  void WakeAll();
  // Asks those that are awake or due. `drain`: nothing more comes.
  void Refresh(InboxTime now, bool drain);
  // The file that goes next; nothing if there is none now. It is handed out by Take().
  struct NextFile {
    InboxSequence* sequence = nullptr;
    InboxSequence::Decision decision;
  };
  NextFile Next(InboxTime now, bool drain);
  void Take(const NextFile& next);
  // When one has something to do, if nothing happens before.
  InboxTime NextDue(InboxTime now, bool drain) const;

  std::size_t waiting() const { return waiting_; }

 private:
  struct Placed {
    bool ready = false;
    InboxTime due = kNever;
  };

  void Place(InboxSequence* sequence, InboxTime now, bool drain);
  void PlaceAt(InboxSequence* sequence, bool ready, InboxTime due);

  const std::string root_;
  const ScanSourceOptions scans_;
  const InboxOptions options_;
  InboxWatcher* const watcher_;
  const Drop drop_;
  std::atomic<std::size_t> waiting_{0};

  std::map<std::string, std::unique_ptr<InboxSequence>> sequences_;
  std::unordered_map<std::string, std::vector<InboxSequence*>> by_stamp_file_;

  // Every sequence with files is asked again when awake, and else when due, or else is ready.
  std::unordered_set<InboxSequence*> awake_;
  std::unordered_map<InboxSequence*, Placed> placed_;
  std::set<std::pair<InboxTime, InboxSequence*>> due_;
  InboxTurns turns_;
};

}  // namespace lamina
