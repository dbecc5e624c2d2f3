// Promises for tests, and what trials of them come to.
#pragma once

#include <fmt/format.h>

#include <stdexcept>
#include <string>

#include "tools/promises/judge.h"
#include "tools/promises/promises.h"
#include "tools/promises/trial.h"

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

// What a promise comes to with one seed.
inline Verdict Tried(const Promise& promise, int seed) {
  return JudgeTrial(MapTrial(promise, seed, {}).frames, promise);
}

// What a shipped one comes to with one seed; with `frames`, over no more than these; with
// `more`, options that the row does not have.
inline Verdict Tried(const std::string& name, int seed, int frames = 0,
                     const std::string& more = "") {
  for (Promise& promise : ReadPromises(ShippedPromises())) {
    if (promise.name != name) continue;
    if (!more.empty()) promise.synth.push_back(more);
    if (frames > 0) promise.synth.push_back(fmt::format("--frames {}", frames));
    return Tried(promise, seed);
  }
  throw std::invalid_argument("no promise of the name " + name);
}

}  // namespace lamina
