// What the bench maps: recordings that it generates, and those that it is given.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace lamina {

struct BenchCase {
  std::string name;
  std::string scans;               // as for `lamina run`; of a generated one, where it is written
  std::string config;              // name or file; empty: the defaults
  std::vector<std::string> set;    // key=value
  std::vector<std::string> synth;  // options of `lamina synth`; empty: a recording that is there
};

//   hdl64  a car in a street among traffic, raw sweeps of some 115000 points
//   vlp16  the same way with a VLP-16
//   avia   a shaken narrow view in a hall: most scans are searched for
std::vector<BenchCase> GeneratedCases(std::size_t frames);

// NAME=SCANS,CONFIG, or NAME=SCANS. Throws OptionError.
BenchCase ParseCase(const std::string& text);

// Writes the recording to `folder` unless the same one is there already, and names it in the case.
// Throws OptionError, OutputError.
void PrepareCase(const std::string& folder, BenchCase* bench_case);

}  // namespace lamina
