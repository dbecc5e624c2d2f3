// What the trials of adverse scenes leave behind.
#pragma once

#include <string>
#include <vector>

#include "tools/promises/covariance.h"
#include "tools/promises/judge.h"

namespace lamina {

struct SeedResult {
  int seed = 0;
  Verdict verdict;
  CovarianceCheck covariance;
  double cpu_s = 0.0;
  std::size_t frames = 0;
};

struct PromiseResults {
  Promise promise;
  std::vector<SeedResult> trials;

  std::size_t kept() const;
};

// Markdown: a row for each promise with the worst of its trials, and what was broken by which seed.
std::string PromiseTable(const std::vector<PromiseResults>& results);

// A line for each trial.
std::string TrialsCsv(const std::vector<PromiseResults>& results);

// A line for each frame of a trial.
std::string FramesCsv(const std::vector<TrialFrame>& frames, const Verdict& verdict);

}  // namespace lamina
