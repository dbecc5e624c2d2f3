// `lamina synth`: writes a synthetic recording with exact ground truth.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tools/synth/sequence.h"

namespace CLI {
class App;
}

namespace lamina {

// Adds the subcommand to `app`. When the command line names it, *run becomes the function that does
// the work; it returns the exit code and throws OptionError or OutputError. `run` must outlive the
// parsing.
void AddSynthCommand(CLI::App* app, std::function<int()>* run);

// The options of a moving sensor as the command line has them ("--scene bays --points 2000"); a
// later text overrides an earlier one. Throws OptionError.
SynthOptions ParseSynthOptions(const std::vector<std::string>& texts);

}  // namespace lamina
