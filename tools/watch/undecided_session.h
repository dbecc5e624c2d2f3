// A session for which no configuration was named: its first scans decide, as they do for `run`.
//
// It begins with the defaults. When 20 scans are there, and ask for something else, it begins anew
// with that, from the first scan on: so its bytes follow from the scans alone, and are those of a
// session begun with what was chosen. Until then it is undecided, which a file in it says.
#pragma once

#include <string>

#include "tools/watch/files.h"

namespace lamina {

class UndecidedSession {
 public:
  UndecidedSession(std::string folder, const WatchFiles& files, DonePolicy policy);

  // Whether a session in this folder would be one: it is new, or is undecided.
  bool Is() const;
  // Before the session is made.
  void Begin() const;
  // When its configuration is written.
  void Decide() const;
  // Whether all of its scans can be mapped again: none of their files has gone.
  bool MayBeginAnew() const;
  // Removes what it has mapped; what is cut short is a session that maps again what its database
  // has, and is undecided still. It must be closed. Throws InputError if another process works on
  // it; OutputError.
  void Clear() const;

 private:
  std::string Path(const std::string& name) const;

  std::string folder_;
  WatchFiles files_;
  DonePolicy policy_;
};

}  // namespace lamina
