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
const std::set<std::string> kStays = {kUndecided, "lock", "log", "token", "rejected", "done"};

}  // namespace

UndecidedSession::UndecidedSession(std::string folder, const WatchFiles& files, DonePolicy policy)
    : folder_(std::move(folder)), files_(files), policy_(policy) {}

std::string UndecidedSession::Path(const std::string& name) const {
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
  // The database last: what is cut short is to be cleared again, not a new session among the rest.
  const std::vector<std::string> database = {"session.db-wal", "session.db-shm", kDatabase};
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder_)) {
    std::string name = entry.path().filename().string();
    const bool last = std::count(database.begin(), database.end(), name) > 0;
    if (!last && kStays.count(name) == 0) names.push_back(std::move(name));
  }
  names.insert(names.end(), database.begin(), database.end());
  for (const std::string& name : names) {
    std::error_code error;
    fs::remove_all(Path(name), error);
    if (error) throw OutputError(Path(name) + ": cannot be removed: " + error.message());
  }
}

}  // namespace lamina
