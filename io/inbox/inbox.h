// The inbox of a stream: a folder into which a recorder, a robot or a converter drops point files,
// and the question which of them comes next.
//
// A file is named by its path relative to the inbox; the name is its identity, and each name is
// handed out once. The files of one folder are one sequence, with the layouts, stamps and order
// that io/recording/scan_source.h describes for a recording: once Drain() has said that nothing
// more comes, a sequence of which nothing had been handed out before gives the very files, order
// and stamps of OpenScans(folder). While files still come:
//
//   complete  A file counts when its writer has closed it or renamed it into the inbox, and it
//             holds what its header declares (.bin: whole points). Where inotify is blind, and for
//             files whose writing was not watched, size and time of change must have rested for
//             settle_s instead. Hidden names and folders (leading dot) and names with another
//             ending (.partial, .tmp, .part) do not count. What stays incomplete without a change
//             for incomplete_wait_s is handed out all the same: its reader rejects it.
//   order     Within a sequence by the stamps in the names, else the natural order of the names. A
//             file waits up to reorder_wait_s for earlier ones, unless nothing seems to be missing:
//             its number is the last one's plus 1, or its stamp follows within one and a half
//             of the least of the last eight gaps. An incomplete file holds up those behind it.
//             Sequences take turns whenever they have a file ready, in natural order of their
//             folders. Those of sensors on one vehicle (io/recording/vehicle_scans.h) give their
//             files in the order of stamps: one waits up to reorder_wait_s for the other sensors to
//             have one, too. Without a recorded stamp it is refused.
//   late      What comes before a file of its sequence that was handed out is set aside, never
//             handed out.
//   first     The first file of a sequence waits for the second (at most incomplete_wait_s), and
//             tells its stamp: the period of a sweep is taken from these two.
//   stamps    From times.txt / timestamps.txt, which may grow with the files: a file waits for its
//             line as it would for missing bytes, then is refused. Names that are whole numbers
//             below 10^9 are line numbers from 0, others take the lines in the order of the files.
//             Without a stamp file, from the names if all are stamps of one form. Else made up. How
//             a sequence has its stamps is settled when its first file is handed out.
//   recording A bag, an MCAP file or a capture of packets is a sequence of its own, whose scans are
//             handed out one by one, named FILE#0, FILE#1, ... (io/recording/recording_file.h). It
//             counts as other files do, when its recorder has written what comes last, and settle_s
//             later; recordings come in natural order of their names, where no other file is ready.
//             A ROS 2 bag counts by its metadata.yaml: *.db3 without one wait for it.
//   links     A symbolic link to a file within the inbox is a file of its own name. Links out of
//             the inbox are refused, links to folders are not followed.
//
// Waits are measured on the steady clock. No call is ever made at an interval without need: see
// Wait().
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "core/options/options.h"
#include "io/recording/scan_source.h"

namespace lamina {

struct InboxOptions {
  // How the inbox is watched. kAuto: by inotify, and by polling where that is not to be had.
  enum class Watch { kAuto, kInotify, kPoll };
  Watch watch = Watch::kAuto;
  // How long a complete file waits for earlier ones, at most.
  double reorder_wait_s = 0.2;
  // Time between two looks at the whole inbox, when polling, and at an incomplete file.
  double poll_period_s = 0.5;
  // A file whose closing was not seen is complete when it has not changed for so long.
  double settle_s = 1.0;
  // How long an incomplete file that does not change holds up those behind it.
  double incomplete_wait_s = 10.0;

  void Visit(OptionVisitor& v);
};

struct InboxFile {
  std::string name;      // relative to the inbox, any bytes but NUL
  std::string path;      // to open it
  std::string sequence;  // its folder relative to the inbox; "" is the inbox itself
  StampNs stamp_ns = 0;
  bool recorded_stamp = false;  // false: made up, number in the sequence * frame_period_s
  // For the first file of a sequence: the stamp of the second. Nothing if none came in time.
  std::optional<StampNs> next_stamp_ns;
  // For a scan of a recording in one file, which is its sequence: that, opened, and the scan's
  // number in it.
  std::shared_ptr<const ScanSource> recording = nullptr;
  std::size_t scan_in_recording = 0;
};

// A file that is never handed out, and why.
struct InboxNotice {
  std::string name;
  std::string reason;
};

// What was handed out of a sequence by an earlier run of the process.
struct SequenceProgress {
  std::string sequence;
  std::size_t files = 0;  // at least 1
  // Of the last of them.
  std::string last_name;  // relative to the inbox
  StampNs last_stamp_ns = 0;
  bool recorded_stamp = false;
};

// One thread at a time; Interrupt() and waiting() from any. All calls throw InputError if the inbox
// is gone (deleted, moved, unmounted), and what `known` throws; of no use afterwards.
class Inbox {
 public:
  using Clock = std::chrono::steady_clock;
  // True for names that were dealt with in an earlier run. Asked once for each name.
  using Known = std::function<bool(const std::string& name)>;

  // Looks at the whole inbox. `now` is for tests. Throws OptionError; InputError if the folder is
  // missing or cannot be watched.
  Inbox(const std::string& folder, const ScanSourceOptions& scans, const InboxOptions& options,
        Known known, std::function<Clock::time_point()> now = Clock::now);
  ~Inbox();

  // Before the first Next(): what an earlier run had handed out of a sequence. Numbers and stamps
  // go on from there, and earlier files are late.
  void Continue(const SequenceProgress& progress);

  // The next file, if there is one by now. Never waits. O(log files) beside what has arrived since
  // the last call.
  std::optional<InboxFile> Next();

  // Files set aside since the last call, because they came after later ones of their sequence.
  std::vector<InboxNotice> TakeLate();
  // Recordings of which all scans were handed out since the last call.
  std::vector<InboxNotice> TakeEnded();
  // Files refused since the last call: links out of the inbox, no regular files, files without a
  // stamp among others with one, names that were taken before, files that were written to after
  // that (once for each, and where inotify sees it). Folders that cannot be read, too.
  std::vector<InboxNotice> TakeRefused();

  // From now on nothing more arrives: what is there is complete, and no file waits for another.
  // Next() then gives nothing only when all is handed out, or while a recording is being opened.
  void Drain();

  // Whether a recording is being opened: beside, since one without an index is read through once,
  // which may take minutes. Next() gives none of its scans before.
  bool opening() const;

  enum class Woken { kReady, kInterrupted, kTimeout };
  // Waits, without using the processor, until Next() has a file or there are new late or refused
  // ones (kReady), for Interrupt(), or for the time.
  Woken Wait(std::chrono::nanoseconds timeout);

  // Ends the Wait() that is under way, or else the next. From any thread or signal handler.
  void Interrupt() noexcept;

  // Files that wait to be handed out, incomplete ones included.
  std::size_t waiting() const;
  // Why the inbox is polled; empty if inotify tells all.
  const std::string& polls() const;
  // Memory kept for each name that was dealt with, in all.
  std::size_t seen_bytes() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lamina
