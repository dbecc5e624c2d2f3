// What is promised for adverse scenes: a Markdown table that a person reads and `lamina adverse`
// tries.
//
// Rows of seven columns count; the heading, its line of dashes and all text around the table do
// not:
//
//   name         of the trial
//   lamina synth options of the scene, as on its command line; `code` quotes are dropped
//   lamina run   a configuration, then key=value pairs: NAME.yaml relative to the file or, where no
//                such file is, one that comes with the program
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
  // For ParseSynthOptions. The `--seed` among them is that of a trial's seed 1.
  std::vector<std::string> synth;
  std::string config;  // both for LoadConfig
  std::vector<std::string> set;
  // One of them is finite.
  double within_m = 0.1;
  double drift_percent = std::numeric_limits<double>::infinity();
  std::optional<int> lost, degenerate;  // at most; none: any number
  std::string tried;
};

// Throws InputError, naming file, line and rule.
std::vector<Promise> ReadPromises(const std::string& path);

// The rows as a table that ReadPromises reads back, wherever it stands if their configurations come
// with the program.
std::string FormatPromises(const std::vector<Promise>& promises);

}  // namespace lamina
