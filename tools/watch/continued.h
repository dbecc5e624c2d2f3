// Where a session stands in its inbox: how a daemon that is started again goes on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "io/inbox/inbox.h"
#include "io/inbox/streamed_scans.h"
#include "io/recording/recording_opener.h"
#include "io/store/session_database.h"
#include "tools/watch/files.h"

namespace lamina {

// Lets an inbox go on behind all scans that are recorded. Returns how many files were set aside as
// late in earlier lives.
std::size_t ContinueInbox(const SessionDatabase& database, Inbox* inbox);

// Scans from `next` on, with what must be known of those before.
std::unique_ptr<StreamedScans> ContinueScans(const SessionDatabase& database, std::int64_t next,
                                             const ScanSourceOptions& options);

// The files of scans that are mapped again, where they are now.
class RepeatedFiles {
 public:
  // Both must outlive it.
  RepeatedFiles(const WatchFiles& files, const ScanSourceOptions& options)
      : files_(files), options_(options) {}

  // Whether FileOf will not have to wait; if its recording is not open, it is opened beside.
  bool Ready(const ScanRecord& row);
  // A scan whose recording cannot be opened any more is there, and says why when it is read.
  InboxFile FileOf(const ScanRecord& row);

 private:
  void Take();

  const WatchFiles& files_;
  const ScanSourceOptions& options_;
  // The recording in one file that was opened last.
  std::string opened_name_;
  std::shared_ptr<const ScanSource> opened_;
  RecordingOpener opener_;
};

}  // namespace lamina
