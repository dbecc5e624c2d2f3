// `lamina run`: a recording becomes poses and a map.
#pragma once

#include <functional>
#include <string>

#include "tools/cli/options.h"

namespace CLI {
class App;
}

namespace lamina {

struct RunArguments {
  std::string scans, out, frames, truth;
  std::string progress = "auto";
  ConfigArguments config;
  std::string loops;  // on, off, or as the configuration has it
  int threads = 0;
  bool keyframes = false;  // the clusters of each keyframe are kept (keyframe_file.h)
  bool quiet = false;      // neither the opening lines nor the summary: one of many recordings
};

// Maps a recording and returns the exit code. Throws InputError, OptionError, OutputError or
// InterruptedError.
int RunRecording(const RunArguments& arguments);

// Adds the subcommand to `app`. When the command line names it, *run becomes the function that does
// the work; it returns the exit code and throws InputError, OptionError or OutputError. `run` must
// outlive the parsing.
void AddRunCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
