// The files of the inbox that are not complete yet: who they are, and when to look at them again.
// The rules are those of io/inbox/inbox.h.
//
// Private to io/inbox.
#pragma once

#include <cstddef>
#include <cstdint>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>

#include "io/inbox/file_arrival.h"
#include "io/inbox/inbox.h"
#include "io/inbox/time.h"
#include "io/inbox/watcher.h"

namespace lamina {

class ArrivingFiles {
 public:
  // `root` must be canonical; names are relative to it.
  ArrivingFiles(std::string root, const InboxOptions& options)
      : root_(std::move(root)), options_(options) {}

  struct Verdict {
    enum class Kind { kArriving, kComplete, kGone, kRefused };
    Kind kind = Kind::kArriving;
    InboxTime since;     // of kComplete
    std::string reason;  // of kRefused
  };

  // A file that was seen. `trust_age`: times of change are of this machine, so that an old file
  // that is found is at rest. kArriving: it is kept in mind, and Check() will tell of it.
  Verdict See(const std::string& name, InboxWatcher::How how, bool trust_age, InboxTime now);

  // Looks at one of the files whose time has come, and says which; false if there is none.
  bool Check(InboxTime now, std::string* name, Verdict* verdict);
  // When Check() has something to do; kNever if nothing arrives.
  InboxTime NextCheck() const { return checks_.empty() ? kNever : checks_.begin()->first; }

  bool Has(const std::string& name) const { return files_.count(name) > 0; }
  void Forget(const std::string& name);
  void Clear();
  // That writers closed their files may not have been told: files count when they rest, too.
  void TrustRest(InboxTime now);

 private:
  struct Arriving {
    std::uint64_t size = 0;
    std::int64_t modified_ns = 0;
    InboxTime changed_at;
    InboxTime check_at = kNever;  // kNever: new
    bool by_rest = false;         // complete when it rests, not only when its writer closes it
  };
  using Files = std::unordered_map<std::string, Arriving>;

  static bool NoteChange(const FileLook& look, InboxTime now, Arriving* arriving);
  void CheckAt(Files::value_type* file, InboxTime at);
  Verdict Judge(Files::value_type* file, const FileLook& look, InboxTime now);

  const std::string root_;
  const InboxOptions options_;
  Files files_;
  // Keys of files_, which stay where they are.
  std::set<std::pair<InboxTime, const std::string*>> checks_;
};

}  // namespace lamina
