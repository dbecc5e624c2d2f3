// Two runs of the bench, figure by figure: what changed, and what is noise.
#pragma once

#include <string>
#include <vector>

#include "tools/benchmark/figures.h"

namespace lamina {

enum class ChangeKind {
  kNone,     // equal
  kChanged,  // by more than the spread of the repeated runs explains
  kNoise,    // by less
  kTooFew    // fewer than three runs of either: their spread is not known
};

// The rule: medians differ if the notches of their box plots do not overlap, that is by more than
// 1.57 (range0 / sqrt(n0) + range1 / sqrt(n1)), the ranges being from quartile to quartile (McGill,
// Tukey and Larsen, The American Statistician 1978). Of figures that are exact, medians differ by
// more than 0.05 %.
ChangeKind Compare(const BenchFigure& before, const BenchFigure& now);

// What Compare says of each figure that both have, as a Markdown table, and what but one of them
// has.
std::string AgainstTable(const BenchReport& before, const BenchReport& now);

}  // namespace lamina
