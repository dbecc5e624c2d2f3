#include "tools/watch_files.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <filesystem>
#include <fstream>

#include "core/error.h"
#include "core/printable_text.h"
#include "tools/command_common.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// Moves over file systems, too. Both names have their folders.
void Move(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::rename(from, to, error);
  if (!error) return;
  fs::copy_file(from, to, fs::copy_options::overwrite_existing);
  fs::remove(from);
}

}  // namespace

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

void WatchFiles::NoteReason(const std::string& name, const std::string& reason) const {
  try {
    const fs::path to = fs::path(session_) / "rejected" / name;
    MakeDirectory(to.parent_path().string());
    // Not waited for to reach the disk: thousands may come at once, and the database knows it, too.
    std::ofstream file(to.string() + ".reason.txt", std::ios::binary);
    file << Printable(reason) << "\n";
    if (!file.flush()) throw OutputError("the reason cannot be written");
  } catch (const std::exception& error) {
    spdlog::warn("{}: cannot be noted as rejected: {}", name, error.what());
  }
}

void WatchFiles::Reject(const std::string& name, const std::string& reason) const {
  NoteReason(name, reason);
  const fs::path from = fs::path(inbox_) / name;
  const fs::path to = fs::path(session_) / "rejected" / name;
  std::error_code error;
  if (fs::exists(to, error) || !fs::exists(from, error)) return;
  fs::create_hard_link(from, to, error);
  if (error) fs::copy_file(from, to, error);
  if (error) spdlog::warn("{}: cannot be copied to rejected/: {}", name, error.message());
}

void WatchFiles::Release(const SessionDatabase& database, std::int64_t from,
                         std::int64_t to) const {
  if (policy_ == DonePolicy::kKeep) return;
  database.ForEach(from, to, [this](const SessionScan& scan) { ReleaseOne(scan); });
}

void WatchFiles::ReleaseOne(const SessionScan& scan) const {
  const fs::path from = fs::path(inbox_) / scan.file;
  try {
    if (!fs::exists(fs::symlink_status(from))) return;
    if (policy_ == DonePolicy::kDelete || scan.skipped) {
      fs::remove(from);
      return;
    }
    const fs::path to = fs::path(session_) / "done" / scan.file;
    MakeDirectory(to.parent_path().string());
    Move(from, to);
  } catch (const std::exception& error) {
    spdlog::warn("{}: is mapped, but cannot be {}: {}", from.string(),
                 policy_ == DonePolicy::kMove ? "moved" : "deleted", error.what());
  }
}

}  // namespace lamina
