#include "tools/watch/undecided_session.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <utility>
#include <vector>

#include "backend/session/folder.h"
#include "core/base/error.h"
#include "io/file/file_writer.h"
#include "io/store/session_database.h"
#include "tools/cli/common.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

constexpr const char *kUndecided = "undecided", *kDatabase = "session.db";

// What a session of other options is to have as well, or is in use.
bool Stays(const std::string& name) {
  static const std::set<std::string> stays = {kUndecided, "lock",     "log",
                                              "token",    "rejected", "done"};
  return stays.count(name) > 0;
}

bool IsOfDatabase(const std::string& name) {
  return name == kDatabase || name == "session.db-wal" || name == "session.db-shm";
}

}  // namespace

UndecidedSession::UndecidedSession(std::string folder, const WatchFiles& files, DonePolicy policy)
    : folder_(std::move(folder)), files_(files), policy_(policy) {}

std::string UndecidedSession::Path(const char* name) const {
  return (fs::path(folder_) / name).string();
}

bool UndecidedSession::Is() const {
  return !fs::exists(Path(kDatabase)) || fs::exists(Path(kUndecided));
}

void UndecidedSession::Begin() const {
  MakeDirectory(folder_);
  WriteTextFile(Path(kUndecided), "");
}

void UndecidedSession::Decide() const {
  std::error_code error;
  fs::remove(Path(kUndecided), error);
  if (error) throw OutputError(Path(kUndecided) + ": cannot be removed: " + error.message());
}

bool UndecidedSession::MayBeginAnew() const {
  try {
    return policy_ == DonePolicy::kKeep ||
           FilesDoneUpTo(SessionDatabase(Path(kDatabase), false)) == 0;
  } catch (const InputError&) {
    return false;  // the session mends its database
  } catch (const OutputError&) {
    return false;  // without room it cannot be read; the session waits for some
  }
}

void UndecidedSession::Clear() const {
  const SessionFolder lock(folder_);
  files_.ForgetRejected();
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder_)) {
    std::string name = entry.path().filename().string();
    if (!Stays(name)) names.push_back(std::move(name));
  }
  // The database last: what is cut short is to be cleared again, not a new session among the rest.
  std::sort(names.begin(), names.end());
  std::stable_partition(names.begin(), names.end(),
                        [](const std::string& name) { return !IsOfDatabase(name); });
  std::reverse(std::find_if(names.begin(), names.end(), IsOfDatabase), names.end());
  for (const std::string& name : names) {
    std::error_code error;
    fs::remove_all(fs::path(folder_) / name, error);
    if (error)
      throw OutputError((fs::path(folder_) / name).string() +
                        ": cannot be removed: " + error.message());
  }
}

}  // namespace lamina
