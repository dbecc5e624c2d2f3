#include "io/inbox/arriving_files.h"

#include <algorithm>
#include <chrono>

namespace lamina {
namespace {

using How = InboxWatcher::How;
using Kind = ArrivingFiles::Verdict::Kind;

// By the wall clock; negative for times of change in the future.
double AgeS(std::int64_t modified_ns) {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const auto now_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
  return static_cast<double>(now_ns - modified_ns) * 1e-9;
}

}  // namespace

ArrivingFiles::Verdict ArrivingFiles::See(const std::string& name, How how, bool trust_age,
                                          InboxTime now) {
  const FileLook look = LookAtFile(root_, name);
  if (look.what != FileLook::What::kFile && look.what != FileLook::What::kDangling) {
    Forget(name);
    const bool refused = look.what == FileLook::What::kRefused;
    return {refused ? Kind::kRefused : Kind::kGone, now, look.reason};
  }
  const bool found = how == How::kFound;
  const bool closed = how == How::kWritten || how == How::kMovedIn || (!found && look.linked);
  const bool rests = found && trust_age && AgeS(look.modified_ns) >= options_.settle_s;
  if (look.what == FileLook::What::kFile && (closed || rests) &&
      IsWhole(root_ + "/" + name, look.size)) {
    Forget(name);
    return {Kind::kComplete, now, ""};
  }
  Files::value_type& file = *files_.try_emplace(name).first;
  Arriving& arriving = file.second;
  if (NoteChange(look, now, &arriving) || arriving.check_at == kNever) arriving.changed_at = now;
  arriving.by_rest = closed || found;
  const double least_s = arriving.by_rest ? options_.settle_s : options_.incomplete_wait_s;
  CheckAt(&file, After(arriving.changed_at, std::min(least_s, options_.incomplete_wait_s)));
  return {};
}

bool ArrivingFiles::NoteChange(const FileLook& look, InboxTime now, Arriving* arriving) {
  if (look.size == arriving->size && look.modified_ns == arriving->modified_ns) return false;
  arriving->size = look.size;
  arriving->modified_ns = look.modified_ns;
  arriving->changed_at = now;
  return true;
}

void ArrivingFiles::CheckAt(Files::value_type* file, InboxTime at) {
  checks_.erase({file->second.check_at, &file->first});
  file->second.check_at = at;
  checks_.emplace(at, &file->first);
}

bool ArrivingFiles::Check(InboxTime now, std::string* name, Verdict* verdict) {
  if (NextCheck() > now || checks_.empty()) return false;
  *name = *checks_.begin()->second;
  *verdict = Judge(&*files_.find(*name), LookAtFile(root_, *name), now);
  if (verdict->kind != Kind::kArriving) Forget(*name);
  return true;
}

ArrivingFiles::Verdict ArrivingFiles::Judge(Files::value_type* file, const FileLook& look,
                                            InboxTime now) {
  Arriving& arriving = file->second;
  const bool dangling = look.what == FileLook::What::kDangling;
  if (look.what == FileLook::What::kRefused) return {Kind::kRefused, now, look.reason};
  if (look.what != FileLook::What::kFile && !dangling) return {Kind::kGone, now, ""};
  NoteChange(look, now, &arriving);
  const InboxTime rests = After(arriving.changed_at, options_.settle_s);
  const InboxTime given_up = After(arriving.changed_at, options_.incomplete_wait_s);
  const bool whole = !dangling && arriving.by_rest && IsWhole(root_ + "/" + file->first, look.size);
  if (whole && now >= rests) return {Kind::kComplete, arriving.changed_at, ""};
  if (now >= given_up) {
    if (dangling) return {Kind::kRefused, now, "is a symbolic link to nothing"};
    return {Kind::kComplete, arriving.changed_at, ""};
  }
  const InboxTime soon = whole ? rests : After(now, options_.poll_period_s);
  CheckAt(file, arriving.by_rest ? std::min(soon, given_up) : given_up);
  return {};
}

void ArrivingFiles::Forget(const std::string& name) {
  const auto found = files_.find(name);
  if (found == files_.end()) return;
  checks_.erase({found->second.check_at, &found->first});
  files_.erase(found);
}

void ArrivingFiles::Clear() {
  checks_.clear();
  files_.clear();
}

void ArrivingFiles::TrustRest(InboxTime now) {
  for (Files::value_type& file : files_) {
    if (file.second.by_rest) continue;
    file.second.by_rest = true;
    CheckAt(&file, After(now, options_.settle_s));
  }
}

}  // namespace lamina
