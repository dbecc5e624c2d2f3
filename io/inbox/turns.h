// Whose turn it is in the inbox, among the sequences that have a file ready (io/inbox/inbox.h).
//
// Private to io/inbox.
#pragma once

#include <map>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "io/file/folder_list.h"
#include "io/inbox/sequence.h"
#include "io/inbox/time.h"

namespace lamina {

class InboxTurns {
 public:
  // How long a sensor's file waits for those of the others on its vehicle, at most.
  explicit InboxTurns(double wait_s) : wait_s_(wait_s) {}

  void PutOnVehicle(InboxSequence* sensor, const std::string& vehicle);
  bool IsOnVehicle(const InboxSequence* sequence) const { return vehicle_of_.count(sequence) > 0; }

  // Whether it has a file ready.
  void SetReady(InboxSequence* sequence, bool ready) {
    if (ready) {
      ready_.insert(sequence);
    } else {
      ready_.erase(sequence);
    }
  }

  // The sequence whose file goes next; null if there is none now: then *due is when to ask again,
  // if nothing happens before.
  InboxSequence* Next(InboxTime now, bool drain, InboxTime* due) const;

 private:
  struct FolderBefore {
    bool operator()(const InboxSequence* a, const InboxSequence* b) const {
      return NaturalLess(a->folder(), b->folder());
    }
  };
  InboxTime TurnOfVehicle(const std::string& vehicle, InboxTime now, bool drain,
                          InboxSequence** first) const;

  double wait_s_;
  std::set<InboxSequence*, FolderBefore> ready_;
  std::map<std::string, std::vector<InboxSequence*>> vehicles_;
  std::unordered_map<const InboxSequence*, std::string> vehicle_of_;
};

}  // namespace lamina
