#include "io/inbox/turns.h"

#include <algorithm>

namespace lamina {

void InboxTurns::PutOnVehicle(InboxSequence* sensor, const std::string& vehicle) {
  vehicles_[vehicle].push_back(sensor);
  vehicle_of_[sensor] = vehicle;
}

InboxSequence* InboxTurns::Next(InboxTime now, bool drain, InboxTime* due) const {
  *due = kNever;
  for (InboxSequence* sequence : ready_) {
    const auto vehicle = vehicle_of_.find(sequence);
    if (vehicle == vehicle_of_.end()) return sequence;
    InboxSequence* first = nullptr;
    const InboxTime turn = TurnOfVehicle(vehicle->second, now, drain, &first);
    if (turn <= now) return first;
    *due = std::min(*due, turn);
  }
  return nullptr;
}

// Of the sensors that have a file, the one with the earliest; and when that may go: at once if all
// others have one, too.
InboxTime InboxTurns::TurnOfVehicle(const std::string& vehicle, InboxTime now, bool drain,
                                    InboxSequence** first) const {
  StampNs earliest_ns = 0;
  InboxTime since = kNever;
  bool all_ready = true;
  for (InboxSequence* sensor : vehicles_.at(vehicle)) {
    if (ready_.count(sensor) == 0) {
      all_ready = false;
      continue;
    }
    const InboxSequence::Decision decision = sensor->Decide(now, drain);
    if (*first != nullptr && decision.stamp_ns >= earliest_ns) continue;
    *first = sensor;
    earliest_ns = decision.stamp_ns;
    since = decision.ready_since;
  }
  return all_ready || drain ? InboxTime::min() : After(since, wait_s_);
}

}  // namespace lamina
