// What becomes of the files of an inbox: those that were mapped, and those that could not be.
#pragma once

#include <cstdint>
#include <string>

#include "io/store/session_database.h"

namespace lamina {

enum class DonePolicy { kKeep, kMove, kDelete };
// "keep", "move" or "delete".
DonePolicy ParseDonePolicy(const std::string& name);

// The scan up to which the policy is done: of those before, files may be gone from the inbox.
std::int64_t FilesDoneUpTo(const SessionDatabase& database);
void SetFilesDoneUpTo(std::int64_t scan, SessionDatabase* database);

// The folders of a session into which files go:
//
//     done/NAME               mapped, under --done move
//     rejected/NAME           could not be mapped, with rejected/NAME.reason.txt beside it
//
// NAME is the path in the inbox. A file is left in the inbox (keep), moved or deleted only when
// nothing can make the session read it again, and a rejected one when rejected/ has all of it;
// until then that is there twice (a link, or a copy where it is on another file system). A
// recording in one file goes, with all its files, when all of its scans may: to rejected/ if some
// of them could not be mapped and it would be deleted. One thread at a time.
class WatchFiles {
 public:
  WatchFiles(std::string inbox, std::string session, DonePolicy policy);

  // Where a file is now: in the inbox, done/ or rejected/. The inbox if it is nowhere.
  std::string Find(const std::string& name) const;

  // Whether the file of a scan, or the recording that it is of, is in one of them.
  bool Has(const ScanRecord& scan) const;

  // Puts a file into rejected/. Only says so in the log if that fails: the stream goes on.
  void Reject(const std::string& name, const std::string& reason) const;
  // A file whose content is none of the session's: only the reason is written down. One in the
  // place of another that was mapped goes to rejected/ when that would be moved or deleted.
  void NoteReason(const std::string& name, const std::string& reason) const;

  // Removes from rejected/ what is in the inbox still, and the reasons: it will be looked at again.
  void ForgetRejected() const;

  // Does with the files of scans [from, to) what the policy says. The same again does no harm.
  // Returns the scan from which on it is to be done again, since the disk was full; `to` otherwise.
  std::int64_t Release(const SessionDatabase& database, std::int64_t from, std::int64_t to) const;

 private:
  // Throws InputError, OutputError.
  void CopyToRejected(const std::string& name) const;
  std::string ReasonPath(const std::string& name) const;
  void ReleaseOne(const ScanRecord& scan) const;
  void ReleaseRecordings(const SessionDatabase& database, std::int64_t to) const;
  void ReleaseRecording(const std::string& name) const;
  void MoveTo(const char* folder, const std::string& name) const;
  bool HasRejectedScans(const std::string& recording) const;

  std::string inbox_, session_;
  DonePolicy policy_;
};

}  // namespace lamina
