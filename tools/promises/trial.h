// One adverse scene, generated and mapped in memory.
#pragma once

#include <vector>

#include "tools/promises/judge.h"

namespace lamina {

struct Trial {
  std::vector<TrialFrame> frames;  // all scans, skipped ones too
  double cpu_s = 0.0;              // of the mapping; right if the thread limit is one
};

// Throws OptionError, naming the promise, if it has options that do not exist or break their rule.
void CheckTrial(const Promise& promise, const std::vector<std::string>& set);

// Trial `seed` has the promise's own `--seed`, 1 if it has none, plus seed - 1.
// `set`, key=value pairs, come after those of the promise. Several threads may run trials at once.
// Throws OptionError.
Trial MapTrial(const Promise& promise, int seed, const std::vector<std::string>& set);

}  // namespace lamina
