// Promises for tests of trials.
#pragma once

#include <string>

#include "tools/promises/promises.h"

namespace lamina {

inline std::string ShippedPromises() { return LAMINA_SOURCE_DIR "/tools/promises/promises.md"; }

// No scan lost or degenerate, and all of them within so much.
inline Promise Within(double within_m) {
  Promise promise;
  promise.name = "trial";
  promise.within_m = within_m;
  promise.lost = 0;
  promise.degenerate = 0;
  return promise;
}

}  // namespace lamina
