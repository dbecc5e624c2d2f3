// What a colleague would say of a weak place of a run: where it is, what was measured against which
// rule, what is the likely cause, and what to change.
#pragma once

#include <string>
#include <vector>

#include "tools/doctor/weak_places.h"

namespace lamina {

struct PlaceAdvice {
  std::string where, measured;  // see place_words.h
  std::string cause;
  std::vector<std::string> settings;  // "key=value" for --set; may be empty
  std::string record;                 // what to do otherwise; may be empty
};

PlaceAdvice Advise(const RunTable& table, const WeakPlaces& places, const WeakPlace& place);

}  // namespace lamina
