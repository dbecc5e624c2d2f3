#include "tools/watch/files.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <filesystem>
#include <fstream>
#include <string_view>
#include <vector>

#include "core/base/error.h"
#include "core/base/printable_text.h"
#include "io/file/disk_room.h"
#include "io/file/file_writer.h"
#include "io/recording/recording_file.h"

namespace lamina {
namespace {

// In the database.
constexpr const char* kDoneUpTo = "files_done_up_to";
// Of the file that says why one was rejected.
constexpr std::string_view kReasonEnding = ".reason.txt";

namespace fs = std::filesystem;

// Moves over file systems, too: the original goes when the copy is on disk. A rename within one
// needs no flushing: a power cut leaves the file under either name.
void Move(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::rename(from, to, error);
  if (!error) return;
  CopyFile(from.string(), to.string());
  fs::remove(from);
}

// Whether a file of that name and size is there: a copy that was cut short is none.
bool HasCopy(const fs::path& from, const fs::path& to) {
  std::error_code error;
  if (!fs::is_regular_file(to, error)) return false;
  const auto size = fs::file_size(from, error);
  return !error && fs::file_size(to, error) == size && !error;
}

}  // namespace

std::int64_t FilesDoneUpTo(const SessionDatabase& database) {
  return std::stoll(database.Meta(kDoneUpTo).value_or("0"));
}

void SetFilesDoneUpTo(std::int64_t scan, SessionDatabase* database) {
  database->SetMeta(kDoneUpTo, std::to_string(scan));
}

DonePolicy ParseDonePolicy(const std::string& name) {
  if (name == "move") return DonePolicy::kMove;
  return name == "delete" ? DonePolicy::kDelete : DonePolicy::kKeep;
}

WatchFiles::WatchFiles(std::string inbox, std::string session, DonePolicy policy)
    : inbox_(std::move(inbox)), session_(std::move(session)), policy_(policy) {}

std::string WatchFiles::Find(const std::string& name) const {
  const fs::path here = fs::path(inbox_) / name;
  std::error_code ignored;
  if (fs::exists(here, ignored)) return here.string();
  for (const char* folder : {"done", "rejected"}) {
    const fs::path other = fs::path(session_) / folder / name;
    if (fs::exists(other, ignored)) return other.string();
  }
  return here.string();
}

bool WatchFiles::Has(const ScanRecord& scan) const {
  std::error_code ignored;
  return fs::exists(Find(ScanNumber(scan.sequence, scan.file) ? scan.sequence : scan.file),
                    ignored);
}

std::string WatchFiles::ReasonPath(const std::string& name) const {
  return (fs::path(session_) / "rejected" / (name + std::string(kReasonEnding))).string();
}

void WatchFiles::NoteReason(const std::string& name, const std::string& reason) const {
  try {
    const std::string path = ReasonPath(name);
    MakeDirectory(fs::path(path).parent_path().string());
    // Not waited for to reach the disk: thousands may come at once, and the database knows it, too.
    std::ofstream file(path, std::ios::binary);
    file << Printable(reason) << "\n";
    if (!file.flush()) throw OutputError("the reason cannot be written");
  } catch (const std::exception& error) {
    spdlog::warn("{}: cannot be noted as rejected: {}", name, error.what());
  }
}

void WatchFiles::Reject(const std::string& name, const std::string& reason) const {
  NoteReason(name, reason);
  try {
    CopyToRejected(name);
  } catch (const std::exception& error) {
    spdlog::warn("{}: cannot be copied to rejected/: {}", name, error.what());
  }
}

void WatchFiles::CopyToRejected(const std::string& name) const {
  const fs::path from = fs::path(inbox_) / name;
  const fs::path to = fs::path(session_) / "rejected" / name;
  std::error_code error;
  if (!fs::exists(from, error) || HasCopy(from, to)) return;
  MakeDirectory(to.parent_path().string());
  fs::remove(to, error);
  fs::create_hard_link(from, to, error);
  if (error) CopyFile(from.string(), to.string());
}

void WatchFiles::ForgetRejected() const {
  const fs::path rejected = fs::path(session_) / "rejected";
  if (!fs::exists(rejected)) return;
  std::vector<fs::path> forgotten;
  for (const auto& entry : fs::recursive_directory_iterator(rejected)) {
    if (entry.is_directory()) continue;
    std::string name = entry.path().lexically_relative(rejected).string();
    if (entry.path().extension() == ".txt" && name.size() > kReasonEnding.size())
      name.resize(name.size() - kReasonEnding.size());
    // Of a scan in a file of many, too.
    const bool here = fs::exists(fs::path(inbox_) / name) ||
                      fs::exists(fs::path(inbox_) / name.substr(0, name.rfind('#')));
    if (here) forgotten.push_back(entry.path());
  }
  for (const fs::path& path : forgotten) fs::remove(path);
}

std::int64_t WatchFiles::Release(const SessionDatabase& database, std::int64_t from,
                                 std::int64_t to) const {
  if (policy_ == DonePolicy::kKeep) return to;
  std::int64_t next = from;
  try {
    database.ForEach(from, to, [&](const ScanRecord& scan) {
      if (!ScanNumber(scan.sequence, scan.file)) ReleaseOne(scan);
      next = scan.scan + 1;
    });
    ReleaseRecordings(database, to);
  } catch (const DiskFullError& error) {
    spdlog::warn("mapped files stay in the inbox until there is room: {}", error.what());
    return next;
  }
  return to;
}

void WatchFiles::MoveTo(const char* folder, const std::string& name) const {
  const fs::path to = fs::path(session_) / folder / name;
  MakeDirectory(to.parent_path().string());
  Move(fs::path(inbox_) / name, to);
}

bool WatchFiles::HasRejectedScans(const std::string& recording) const {
  const fs::path reasons = fs::path(session_) / "rejected" / recording;
  const std::string begin = reasons.filename().string() + "#";
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(reasons.parent_path(), none)) {
    if (entry.path().filename().string().compare(0, begin.size(), begin) == 0) return true;
  }
  return false;
}

// Those of which the inbox has said that nothing is left, and whose last scan is before `to`.
void WatchFiles::ReleaseRecordings(const SessionDatabase& database, std::int64_t to) const {
  for (const SessionDatabase::Sequence& sequence : database.Sequences(database.scans())) {
    const std::string& name = sequence.last.sequence;
    if (!ScanNumber(name, sequence.last.file) || sequence.last.scan >= to) continue;
    const fs::path from = fs::path(inbox_) / name;
    if (!database.Knows(name) || !fs::exists(fs::symlink_status(from))) continue;
    try {
      ReleaseRecording(name);
    } catch (const DiskFullError&) {
      throw;
    } catch (const std::exception& error) {
      spdlog::warn("{}: is mapped, but cannot be {}: {}", from.string(),
                   policy_ == DonePolicy::kMove ? "moved" : "deleted", error.what());
    }
  }
}

void WatchFiles::ReleaseRecording(const std::string& name) const {
  const bool rejected = HasRejectedScans(name);
  for (const std::string& file : FilesOfRecording((fs::path(inbox_) / name).string())) {
    const fs::path part = fs::path(name).parent_path() / fs::path(file).filename();
    if (!fs::exists(fs::symlink_status(fs::path(inbox_) / part))) continue;
    if (policy_ == DonePolicy::kDelete && !rejected) {
      fs::remove(fs::path(inbox_) / part);
    } else {
      MoveTo(policy_ == DonePolicy::kMove ? "done" : "rejected", part.string());
    }
  }
}

void WatchFiles::ReleaseOne(const ScanRecord& scan) const {
  const fs::path from = fs::path(inbox_) / scan.file;
  try {
    if (!fs::exists(fs::symlink_status(from))) return;
    // There may have been no room for the copy when it was rejected.
    if (scan.skipped) CopyToRejected(scan.file);
    // Of a mapped file there is none: this is another one, which came in its place.
    if (!scan.skipped && fs::exists(ReasonPath(scan.file))) return MoveTo("rejected", scan.file);
    if (policy_ == DonePolicy::kDelete || scan.skipped) {
      fs::remove(from);
      return;
    }
    MoveTo("done", scan.file);
  } catch (const DiskFullError&) {
    throw;
  } catch (const std::exception& error) {
    spdlog::warn("{}: is mapped, but cannot be {}: {}", from.string(),
                 policy_ == DonePolicy::kMove ? "moved" : "deleted", error.what());
  }
}

}  // namespace lamina
