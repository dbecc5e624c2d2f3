// What is promised for adverse scenes: a Markdown table that a person reads and `lamina adverse`
// tries.
//
// Rows of seven columns count; the heading, its line of dashes and all text around the table do
// not:
//
//   name         of the trial
//   lamina synth options of the scene, as on its command line; `code` quotes are dropped
//   lamina run   a configuration, NAME.yaml relative to the file, then key=value pairs
//   within m     of the truth: every frame that is reported neither lost nor degenerate. Or with %:
//                the drift, mean error over stretches of 100 m
//                (tools/metrics/trajectory_metrics.h), for long ways on which no distance can be
//                promised
//   lost         so many frames at most are lost or skipped, and the map stays in one piece; any:
//                both are free
//   degenerate   so many frames at most are degenerate; any
//   tried        what it is about, in words
//
// A row named (all) comes first, if there is one: its options precede those of each other row.
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace lamina {

struct Promise {
  std::string name;
  std::vector<std::string> synth;  // for ParseSynthOptions
  std::string config;              // both for LoadConfig
  std::vector<std::string> set;
  // One of them is finite.
  double within_m = 0.1;
  double drift_percent = std::numeric_limits<double>::infinity();
  std::optional<int> lost, degenerate;  // at most; none: any number
  std::string tried;
};

// Throws InputError, naming file, line and rule.
std::vector<Promise> ReadPromises(const std::string& path);

}  // namespace lamina
