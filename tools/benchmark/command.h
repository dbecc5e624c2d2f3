// `lamina bench`: what mapping takes, measured run by run, and against an earlier measurement.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// Adds the subcommand to `app`. When the command line names it, *run becomes the function that does
// the work; it returns the exit code and throws InputError, OptionError or OutputError. `run` must
// outlive the parsing.
void AddBenchCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
